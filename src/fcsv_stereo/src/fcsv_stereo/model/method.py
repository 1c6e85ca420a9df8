# SPDX-License-Identifier: Apache-2.0
"""What every mapping method offers; ``pipeline.METHODS`` holds those that there are."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Optional, Type

from fcsv_stereo.model.inputs import MapInput
from fcsv_stereo.model.results import MapResult, Progress


def silent(_step: str, _share: float) -> None:
    """Progress that nobody looks at."""


def part(progress: Progress, begins: float, ends: float) -> Progress:
    """Progress of a part of the work, which begins and ends at these shares of the whole."""
    return lambda step, share: progress(step, begins + (ends - begins) * share)


class Method(ABC):
    """A way from an input to a map.

    ``name`` is what ``--method`` takes. ``options`` is the frozen dataclass of the method's
    choices; its defaults are the method's own. ``refines_poses`` says whether it improves poses or
    takes them as they are, ``matches_bars`` whether it can match straight thin things as wholes.
    """

    name: ClassVar[str]
    options: ClassVar[Type[Any]]
    refines_poses: ClassVar[bool] = False
    matches_bars: ClassVar[bool] = False

    @abstractmethod
    def map(self, given: MapInput, options: Any = None, progress: Progress = silent) -> MapResult:
        """The map of all configurations; ``options`` None takes the defaults. Raises StereoError
        where there is none.

        ``timing_s`` has "refine", "match" and "fuse".
        """

    @property
    @abstractmethod
    def quick(self) -> Any:
        """Options for a first look in flight: a configuration's map while the vehicles wait."""

    @property
    def monitor(self) -> Any:
        """Options for depth again and again of what vehicles see while they hold."""
        return self.quick

    @property
    def complete(self) -> Any:
        """Options that answer every pixel that can be answered at all; what all pixels' figures are
        measured with."""
        return self.options()

    def remembering(self, options: Any, _known: Any) -> Any:
        """Options with a memory (KnownFeatures) for the features of pictures that come again; as
        they are here."""
        return options

    def trusting_poses(self, options: Any) -> Any:
        """Options under which poses are taken as they are."""
        return options

    def with_bars(self, options: Any) -> Any:
        """Options under which straight thin things are matched as wholes, too; as they are here."""
        return options

    def with_depth_steps(self, _options: Any, _steps: int) -> Optional[Any]:
        """Options with a number of steps of depth (or disparity); None where the method has no such
        thing."""
        return None
