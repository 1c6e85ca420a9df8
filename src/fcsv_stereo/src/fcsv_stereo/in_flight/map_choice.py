# SPDX-License-Identifier: Apache-2.0
"""What is mapped next in flight, of what came in so far: the decisions of the node live_map, without
ROS, threads and clocks."""

from dataclasses import dataclass
from typing import Callable, Dict, Optional, Sequence, Set

import numpy as np

from fcsv_stereo.errors import InputError
from fcsv_stereo.in_flight.live import Corrections, LiveSession, RecordingWindow
from fcsv_stereo.instants import MOST_SKEW_S
from fcsv_stereo.model import LivePicture, MapInput, MapResult, Word

_NOT_OF_ONE_INSTANT_S = 3.0  # of pictures; then it is said
_FIRST_LOOK_PICTURES = 1  # of each vehicle and configuration: who flies waits for it


class MapKind(Word):
    """Names how thoroughly something is mapped."""

    FIRST_LOOK = "first look"  # few pictures, quick; the whole follows once nothing new comes
    WHOLE = "whole"
    INSTANT = "instant"  # what all see now, poses refined
    INSTANT_CORRECTED = "instant, corrected"  # poses corrected by what was found before


#: What shows what vehicles see now.
WATCHING = (MapKind.INSTANT, MapKind.INSTANT_CORRECTED)


@dataclass(frozen=True)
class MapTask:
    """Holds what to map, and the stamp (s) of the newest picture that it takes into account;
    ``view``: from which station and heading, empty: from home."""

    kind: MapKind
    given: MapInput
    newest_s: float
    view: str = ""

    @property
    def names(self) -> str:
        """The configurations, for people."""
        return ", ".join(c.configuration.name for c in self.given.configurations)


class MapChoice:
    """Takes in what comes over the link; ``next`` chooses what is mapped of it."""

    def __init__(self):
        self.session = LiveSession()
        self._news = False

    @property
    def waits(self) -> bool:
        """Whether nothing came that could change the choice."""
        return not self._news

    def on_frames(
        self,
        T_home_odom: Dict[str, np.ndarray],
        held_at: Optional[Callable[[float], Dict[str, np.ndarray]]] = None,
    ) -> None:
        """Where the vehicles' odometry frames lie in home, (4, 4) by vehicle; ``held_at``: the same
        at a moment (s), for earlier pictures."""
        self.session.T_home_odom, self.session.held_at = T_home_odom, held_at
        self._news = True

    def on_window(self, window: RecordingWindow) -> None:
        """A recording ended; said again it is looked at again."""
        self.session.add_window(window)
        self._news = True

    def on_picture(self, picture: LivePicture) -> None:
        """A picture came."""
        self.session.add_picture(picture)
        self._news = True

    def on_covariance(self, vehicle: str, stamp_s: float, covariance: np.ndarray) -> None:
        """How well a vehicle's camera is known in home, (6, 6)."""
        self.session.add_covariance(vehicle, stamp_s, covariance)

    def next(self) -> Optional[MapTask]:
        """What to map now; None: nothing. Raises InputError where what came cannot be mapped."""
        raise NotImplementedError

    def learn(self, task: MapTask, result: MapResult) -> None:
        """Takes what a map found for the next one."""


class MissionMaps(MapChoice):
    """Chooses maps of a mission that grow in flight: a first look at every configuration that is
    new, then the whole."""

    def __init__(self):
        super().__init__()
        self._first_looks: Set[int] = set()  # indices of windows
        self._whole_is_due = False

    @property
    def waits(self) -> bool:
        """Whether nothing is to be mapped before something comes."""
        return not (self._news or self._whole_is_due)

    def on_window(self, window: RecordingWindow) -> None:
        """A recording ended; said again it is looked at again."""
        super().on_window(window)
        self._first_looks.discard(window.index)

    def next(self) -> Optional[MapTask]:
        """A first look at what is new, the whole where nothing is."""
        if self._news:
            self._news = False
            task = self._first_look()
            if task is not None:
                self._whole_is_due = True
                return task
        if not self._whole_is_due:
            return None
        self._whole_is_due = False
        inputs, newest_s = self.session.inputs(), self.session.last_picture_s()
        return MapTask(MapKind.WHOLE, inputs, newest_s, self.session.view)

    def _first_look(self) -> Optional[MapTask]:
        complete = {i for i in self.session.windows if self.session.complete(i)}
        if complete <= self._first_looks:
            return None
        given = self.session.inputs(_FIRST_LOOK_PICTURES)
        self._first_looks = complete
        return MapTask(MapKind.FIRST_LOOK, given, self.session.last_picture_s())


class Monitoring(MapChoice):
    """Chooses, while vehicles hold (3.6), the newest instant that all of them saw.

    ``vehicles``: the reference first; pictures are of one instant where they are at most
    ``apart_s`` (s) apart. Poses are refined in one map of ``refine_every`` and corrected as found
    in between; not corrected where the method refines none (``refines_poses``).
    """

    def __init__(
        self,
        vehicles: Sequence[str],
        apart_s: float = MOST_SKEW_S,
        refine_every: int = 1,
        refines_poses: bool = True,
    ):
        super().__init__()
        self._reference, self._others = vehicles[0], list(vehicles[1:])
        self._apart_s, self._refine_every = apart_s, refine_every
        self._refines_poses, self._corrections = refines_poses, Corrections()
        self._count, self._last_s = 0, float("-inf")  # of maps; stamp of the last reference

    def look_again(self) -> None:
        """Something came into the session that is shared."""
        self._news = True

    def next(self) -> Optional[MapTask]:
        """The newest instant; None: nothing new. Raises InputError, also where pictures come, and
        none are of one instant."""
        if not self._news:
            return None
        self._news = False
        given = self.session.newest(self._reference, self._others, self._apart_s, self._last_s)
        if given is None:
            self._require_one_instant()
            return None
        self._last_s = given.configurations[0].references[0].stamp_s
        taken = [p for c in given.configurations for p in (*c.references, *c.others)]
        newest_s = max(p.stamp_s for p in taken)
        self._count += 1
        refine = (self._count - 1) % self._refine_every == 0 or not self._corrections.know(given)
        if refine or not self._refines_poses:
            return MapTask(MapKind.INSTANT, given, newest_s)
        return MapTask(MapKind.INSTANT_CORRECTED, self._corrections.apply(given), newest_s)

    def learn(self, task: MapTask, result: MapResult) -> None:
        """What a map found of the vehicles' places corrects the next ones."""
        self._corrections.learn(result)

    def _require_one_instant(self) -> None:
        long_s, apart_s = self.session.apart_s(self._reference, self._others, self._last_s)
        if long_s >= _NOT_OF_ONE_INSTANT_S and apart_s > self._apart_s:
            said = f"{1e3 * apart_s:.0f} ms apart" if apart_s < 1e6 else "of one vehicle only"
            limit = f"apart_s:={self._apart_s:g}"
            raise InputError(f"newest pictures are {said} ({limit}): trigger the cameras together")


class WatchedMaps(MissionMaps):
    """Chooses maps of a mission, and once one is whole, between them what ``watch`` chooses of what
    vehicles that hold see: it watches the place."""

    def __init__(self, watch: Monitoring):
        super().__init__()
        self._watch = watch
        self.session = watch.session
        self._is_mapped = False

    def next(self) -> Optional[MapTask]:
        """A map that is due, else the newest instant."""
        news = self._news
        task = super().next()
        if task is not None or not (news and self._is_mapped):
            return task
        self._watch.look_again()
        return self._watch.next()

    def learn(self, task: MapTask, result: MapResult) -> None:
        """Takes what a map found for the next one."""
        if task.kind is MapKind.WHOLE:
            self._is_mapped = True
        elif task.kind in WATCHING:
            self._watch.learn(task, result)
