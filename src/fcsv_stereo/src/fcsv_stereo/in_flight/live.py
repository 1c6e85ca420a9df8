# SPDX-License-Identifier: Apache-2.0
"""A map that grows in flight: pictures, recording windows and frames as they come in; what can be
mapped so far."""

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Callable, Deque, Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import (
    FLOWN,
    Configuration,
    ConfigurationInput,
    InputKind,
    LivePicture,
    MapInput,
    MapResult,
    Picture,
    Word,
)
from fcsv_stereo.pose_covariance import KnownCovariances, unknown_warning
from fcsv_stereo.sweeps import MOVES_M, spread

_ALL = 10**6  # pictures
# pictures of all sweeps in a map, by how many of each stop; else what ``spread`` takes
_SWEPT = {1: 5}
_GONE_S = 2.0  # of the reference's pictures without one of another vehicle: it is not waited for
_MOST_COVARIANCES = 900  # of a vehicle: half a minute at 30 Hz, longer than a picture is on its way


class MapStage(Word):
    """Names the stage of a map that grows in flight, as fcsv_msgs/MapState has it."""

    WAITING = "waiting"
    MAPPING = "mapping"
    PARTIAL = "partial"  # a quick look; the finished one follows
    READY = "ready"
    FAILED = "failed"


@dataclass(frozen=True)
class RecordingWindow:
    """The recording of one configuration: pictures with start_s <= stamp <= stop_s. ``view``: from
    which station and heading it was taken, in words; empty: from home."""

    index: int
    configuration: Configuration
    reference: str
    vehicle: str
    start_s: float
    stop_s: float
    view: str = ""

    def holds(self, stamp_s: float) -> bool:
        """Whether a stamp belongs to it."""
        return self.start_s <= stamp_s <= self.stop_s


@dataclass
class LiveSession:
    """What is known so far. ``most_pictures`` of a vehicle are kept outside of windows, and all
    inside."""

    most_pictures: int = 60
    T_home_odom: Dict[str, np.ndarray] = field(default_factory=dict)
    # as it held at a moment (s), where the column was calibrated again in flight
    held_at: Optional[Callable[[float], Dict[str, np.ndarray]]] = None
    windows: Dict[int, RecordingWindow] = field(default_factory=dict)
    _covariances: Dict[str, KnownCovariances] = field(default_factory=dict)
    _newest: Dict[str, Deque[LivePicture]] = field(default_factory=dict)
    _kept: Dict[int, Dict[str, List[LivePicture]]] = field(default_factory=dict)

    def add_picture(self, picture: LivePicture) -> None:
        """A picture came; those of a window may come before or after its end is said."""
        known = self._covariances.get(picture.vehicle)
        if known is not None:
            picture = replace(picture, covariance=known.at(picture.stamp_s))
        newest = self._newest.setdefault(picture.vehicle, deque(maxlen=self.most_pictures))
        newest.append(picture)
        for window in self.windows.values():
            if picture.vehicle in (window.reference, window.vehicle) and window.holds(
                picture.stamp_s
            ):
                self._keep(window, picture)

    def add_covariance(self, vehicle: str, stamp_s: float, covariance: np.ndarray) -> None:
        """How well a vehicle's camera is known in home, said before its pictures of that time
        come."""
        self._covariances.setdefault(vehicle, KnownCovariances(_MOST_COVARIANCES)).add(
            stamp_s, covariance
        )

    def add_window(self, window: RecordingWindow) -> None:
        """A recording ended; said again with the same index it is replaced. One from another
        station or heading begins another map."""
        if any(w.view != window.view for w in self.windows.values()):
            self.windows, self._kept = {}, {}
        before = self._kept.get(window.index, {})  # of a sweep that was shorter then
        self.windows[window.index] = window
        self._kept[window.index] = {}
        for vehicle in (window.reference, window.vehicle):
            for picture in (*before.get(vehicle, ()), *self._newest.get(vehicle, ())):
                if window.holds(picture.stamp_s):
                    self._keep(window, picture)

    @property
    def view(self) -> str:
        """Station and heading of the windows, in words; empty: home, or there are no windows."""
        return next((w.view for w in self.windows.values()), "")

    def complete(self, index: int) -> bool:
        """Whether both vehicles' pictures of a window have come."""
        return len(self._kept.get(index, {})) == 2

    def last_picture_s(self) -> float:
        """Stamp of the newest picture of the windows that are complete; of which a map may take
        others."""
        complete = [kept for index, kept in self._kept.items() if self.complete(index)]
        return max(pictures[-1].stamp_s for kept in complete for pictures in kept.values())

    def missing(self) -> List[str]:
        """One line for each window that cannot be mapped yet."""
        lines = []
        for index, window in sorted(self.windows.items()):
            absent = [v for v in (window.reference, window.vehicle) if v not in self._kept[index]]
            if absent:
                lines.append(
                    f"configuration '{window.configuration.name}': no picture of {', '.join(absent)} yet"
                )
        return lines

    def inputs(self, most_per_vehicle: int = 3) -> MapInput:
        """All windows that are complete, ``most_per_vehicle`` pictures of each about its middle;
        broken ones are named. Of a sweep as many configurations as it has steps
        (``sweeps.spread``).

        Raises InputError where there is none, or where a vehicle's place in home is not known.
        """
        configurations, problems = [], self.missing()
        for index, window in sorted(self.windows.items()):
            if not self.complete(index):
                continue
            most = _ALL if self._moves(index, window.vehicle) else most_per_vehicle
            sides = [
                self._middle(index, v, most, problems) for v in (window.reference, window.vehicle)
            ]
            if all(sides):
                configurations.append(ConfigurationInput(window.configuration, *sides))
        if not configurations:
            raise InputError(
                "; ".join(["no configuration has pictures of both vehicles yet", *problems])
            )
        problems += unknown_warning(configurations, FLOWN)
        configurations = spread(
            configurations, *([_SWEPT[most_per_vehicle]] if most_per_vehicle in _SWEPT else [])
        )
        return MapInput(InputKind.SESSION, configurations, None, problems, FLOWN)

    def newest(
        self, reference: str, others: Sequence[str], apart_s: float, after_s: float = float("-inf")
    ) -> Optional[MapInput]:
        """Chooses, for monitoring (3.6): the newest pictures of vehicles that hold, one pair for
        each of ``others``.

        One that sends no more pictures while the reference does, as after a drop-out, is left out
        after 2 s. None while there is no picture of the reference after ``after_s`` of which every
        other vehicle has one within ``apart_s``. Raises InputError.
        """
        others = [v for v in others if not self._gone(reference, v)]
        for anchor in reversed(self._newest.get(reference, ())) if others else ():
            chosen = [_nearest(self._newest.get(v, ()), anchor.stamp_s, apart_s) for v in others]
            if anchor.stamp_s > after_s and all(c is not None for c in chosen):
                break
        else:
            return None
        first = self._posed(anchor)
        pairs = []
        for other in (self._posed(c) for c in chosen):
            c = Configuration.between(first.T_home_cam, other.T_home_cam)
            c = replace(c, name=f"{other.vehicle}, {c.axis} {c.baseline_m:.1f} m")
            pairs.append(ConfigurationInput(c, [first], [other]))
        return MapInput(InputKind.SESSION, pairs, prior=FLOWN)

    def apart_s(self, reference: str, others: Sequence[str], after_s: float) -> Tuple[float, float]:
        """Says, of the reference's pictures after ``after_s``: how long they go on (s), and how far
        (s) the other vehicles' nearest is from the one that is best off; infinite where one has
        none.
        """
        after = [p.stamp_s for p in self._newest.get(reference, ()) if p.stamp_s > after_s]
        if not after:
            return 0.0, float("inf")
        others = [v for v in others if not self._gone(reference, v)]
        stamps = [[p.stamp_s for p in self._newest.get(v, ())] or [float("inf")] for v in others]
        if not stamps:
            return after[-1] - after[0], float("inf")
        return after[-1] - after[0], min(
            max(min(abs(s - t) for t in of) for of in stamps) for s in after
        )

    def _gone(self, reference: str, vehicle: str) -> bool:
        """Whether the reference sent pictures for a while, and the vehicle none."""
        newest = self._newest.get(vehicle)
        since = [
            p.stamp_s
            for p in self._newest.get(reference, ())
            if not newest or p.stamp_s > newest[-1].stamp_s
        ]
        return bool(since) and since[-1] - since[0] >= _GONE_S

    def _keep(self, window: RecordingWindow, picture: LivePicture) -> None:
        kept = self._kept[window.index].setdefault(picture.vehicle, [])
        if all(picture.stamp_s != p.stamp_s for p in kept):
            kept.append(picture)
            kept.sort(key=lambda p: p.stamp_s)

    def _moves(self, index: int, vehicle: str) -> bool:
        """Whether the vehicle moved while it was recorded."""
        places = np.array([p.T_odom_cam[:3, 3] for p in self._kept[index][vehicle]])
        return float(np.linalg.norm(places - places[0], axis=1).max()) > MOVES_M

    def _middle(self, index: int, vehicle: str, most: int, problems: List[str]) -> List[Picture]:
        kept = self._kept[index][vehicle]
        middle = (len(kept) - 1) / 2
        pictures: List[Picture] = []
        for _, picture in sorted(enumerate(kept), key=lambda entry: abs(entry[0] - middle)):
            T_home_odom = self._T_home_odom_of(picture)
            try:
                pictures.append(picture.picture(T_home_odom))
            except InputError as error:
                problems.append(f"left out: {error}")
            if len(pictures) == most:
                break
        return sorted(pictures, key=lambda p: p.stamp_s)

    def _posed(self, picture: LivePicture) -> Picture:
        return picture.picture(self._T_home_odom_of(picture))

    def _T_home_odom_of(self, picture: LivePicture) -> np.ndarray:
        vehicle = picture.vehicle
        held = self.held_at(picture.stamp_s) if self.held_at else self.T_home_odom
        if vehicle not in held:
            raise InputError(f"where {vehicle} is in home is not known: calibrate, then set home")
        return held[vehicle]


class Corrections:
    """What refinement found of each vehicle's place, for later pictures of vehicles that hold.

    What is wrong with a flown pose is where its odometry frame lies in home (calibration and
    drift), which changes slowly; the odometry follows the airframe's vibration by itself:
    T_home_cam = C T_home_cam_prior.
    """

    def __init__(self):
        self._C: Dict[str, np.ndarray] = {}

    def learn(self, result: MapResult) -> None:
        """Learns from a map whose poses were refined."""
        for image in result.images:
            if image.refined:
                self._C[image.vehicle] = image.T_home_cam @ transforms.invert(
                    image.prior_T_home_cam
                )

    def know(self, given: MapInput) -> bool:
        """Whether every other vehicle's correction is known."""
        return all(p.vehicle in self._C for c in given.configurations for p in c.others)

    def apply(self, given: MapInput) -> MapInput:
        """The same input with better poses."""
        better = [
            replace(
                c,
                others=[replace(p, T_home_cam=self._C[p.vehicle] @ p.T_home_cam) for p in c.others],
            )
            for c in given.configurations
        ]
        return replace(given, configurations=better)


def _nearest(pictures, stamp_s: float, apart_s: float) -> Optional[LivePicture]:
    near = [p for p in pictures if abs(p.stamp_s - stamp_s) <= apart_s]
    return min(near, key=lambda p: abs(p.stamp_s - stamp_s)) if near else None
