# SPDX-License-Identifier: Apache-2.0
"""One calibration of the column: collects the tags that vehicles see until there are enough, then
finds the links."""

import logging
from dataclasses import dataclass
from typing import Callable, Dict, List, Mapping, Sequence

import numpy as np

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.trajectory import Trajectory
from fcsv_geometry.vehicles.telemetry import CalibrationFound, SeenTag, SeenTags
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_tracking.column.calibration import CalibrationRules, Link, calibrate_link
from fcsv_tracking.column.detection import Detection
from fcsv_tracking.column.loops import merge_loops
from fcsv_tracking.devices.clocks import ClockOffset, difference
from fcsv_tracking.errors import CalibrationRefused, ClocksApart, TrackingError

_log = logging.getLogger(__name__)
_PLENTY = 1.25  # times the least: a few are always refused
_SILENT_S = 4.0  # a link that shows no tag for so long will not get enough


@dataclass(frozen=True)
class _SeenTags:
    came_s: float
    tags: SeenTags


class CalibrationSession:
    """Calibrates the vehicles of a ``column``, front first, begun at ``now_s``; ``duration_s`` 0:
    as long as it takes. ``drop(what, why)`` is told what is of no use. Raises TrackingError where
    the column is none."""

    def __init__(
        self,
        now_s: float,
        column: Sequence[str],
        duration_s: float,
        vehicles: Mapping[str, VehicleGeometry],
        rules: CalibrationRules,
        drop: Callable[[str, str], None],
    ):
        if len(column) < 2 or not set(column) <= set(vehicles):
            raise TrackingError(
                f"a column needs two known vehicles or more, front first; got {list(column)}"
            )
        self.column = list(column)
        self._vehicles, self._rules, self._drop = vehicles, rules, drop
        self._until_s = now_s + (duration_s or rules.duration_s)
        self._longest_s = self._until_s if duration_s else now_s + rules.longest_s
        self._seen: Dict[str, List[_SeenTags]] = {n: [] for n in column}

    def tags(self, now_s: float, seen: SeenTags) -> None:
        """A vehicle's picture was looked at."""
        if seen.vehicle in self._seen:
            self._seen[seen.vehicle].append(_SeenTags(now_s, seen))

    def enough(self, now_s: float) -> bool:
        """Whether it is over: every link has plenty, one gets no more, or the time is over."""
        if now_s < self._until_s:
            return False
        links = [self._came_s(front, back) for front, back in zip(self.column, self.column[1:])]
        silent = any(not came or now_s - came[-1] > _SILENT_S for came in links)
        plenty = all(len(came) >= _PLENTY * self._rules.least_detections for came in links)
        return silent or plenty or now_s >= self._longest_s

    def found(
        self, tracks: Mapping[str, Trajectory], clocks: Mapping[str, ClockOffset]
    ) -> CalibrationFound:
        """The links, for the moment (s) that all hold for: what the vehicles fly after it adds to
        their errors.

        ``tracks`` and ``clocks`` by vehicle. Raises CalibrationRefused with the reason and what to
        do.
        """
        links, ends_s = [], []
        for front, back in zip(self.column, self.column[1:]):
            seen = self._detections(front, back, tracks, clocks)
            links.append(calibrate_link(front, back, seen, self._rules))
            ends_s.append(max(d.stamp_s for d in seen))
        return CalibrationFound(min(ends_s), merge_loops(links, self._loops(tracks, clocks)))

    def _came_s(self, front: str, back: str) -> List[float]:
        """When pictures of ``back`` came in which it sees ``front``."""
        tag_id = self._vehicles[front].tag_id
        return [s.came_s for s in self._seen[back] if any(t.id == tag_id for t in s.tags.tags)]

    def _loops(
        self, tracks: Mapping[str, Trajectory], clocks: Mapping[str, ClockOffset]
    ) -> List[Link]:
        """What vehicles see of tags further ahead, where that is good enough; the column does not
        depend on it."""
        found = []
        for i, back in enumerate(self.column):
            for front in self.column[: max(i - 1, 0)]:
                try:
                    seen = self._detections(front, back, tracks, clocks)
                    found.append(calibrate_link(front, back, seen, self._rules))
                except CalibrationRefused as error:
                    _log.debug("no loop from %s to %s: %s", front, back, error)
        return found

    def _detections(
        self,
        front: str,
        back: str,
        tracks: Mapping[str, Trajectory],
        clocks: Mapping[str, ClockOffset],
    ) -> List[Detection]:
        self._require_one_time(clocks, front, back)
        tag_id, found, without_pose = self._vehicles[front].tag_id, [], 0
        for picture in (s.tags for s in self._seen[back]):
            seen = [tag for tag in picture.tags if tag.id == tag_id]
            if len(seen) > 1:
                self._drop("detections", f"{back} sees {len(seen)} tags of {front}'s id {tag_id}")
                continue
            for tag in seen:
                try:
                    found.append(self._detection(front, tracks[front], picture, tag))
                except CalibrationRefused:
                    raise
                except FcsvError:
                    without_pose += 1
        if without_pose > len(found):
            raise CalibrationRefused(
                f"{without_pose} of {len(self._seen[back])} pictures of {back} have no pose of {front} at their stamp: "
                f"check the radio link and that the clocks agree (chrony)"
            )
        return found

    def _require_one_time(self, clocks: Mapping[str, ClockOffset], front: str, back: str) -> None:
        apart, most_s = (
            difference(clocks.get(front), clocks.get(back)),
            self._rules.most_clock_offset_s,
        )
        if apart is not None and abs(apart[0]) - apart[1] > most_s:
            raise ClocksApart(
                f"the clocks of {front} and {back} differ by {apart[0]:.3f} s (bound {most_s} s): start chrony on "
                f"both, with the control PC as server"
            )

    def _detection(
        self, front: str, track: Trajectory, picture: SeenTags, tag: SeenTag
    ) -> Detection:
        """Raises PoseUnavailable, or TrackingError where the picture is none that can be used."""
        vehicle, corners = self._vehicles[front], tag.corners_normalized
        if picture.T_odom_cam is None:
            raise TrackingError("the camera's pose is none")
        if not (
            np.isfinite(corners).all() and np.isfinite(picture.focal_px) and picture.focal_px > 0
        ):
            raise TrackingError("corners or focal length are not finite")
        if not np.isclose(tag.size_m, vehicle.tag_size_m, rtol=1e-3):
            raise CalibrationRefused(
                f"{picture.vehicle} takes {front}'s tag to be {tag.size_m:g} m wide, {front}'s file says "
                f"{vehicle.tag_size_m:g} m: give both machines the same files"
            )
        T_odom_tag = track.at(picture.stamp_s) @ vehicle.T_body_tag
        return Detection(
            picture.stamp_s, corners, tag.size_m, picture.focal_px, picture.T_odom_cam, T_odom_tag
        )
