# SPDX-License-Identifier: Apache-2.0
"""Frames of the vehicles' depth cameras from the bags of a session, with their poses in home
(fcsv_stereo.near)."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, Iterator, List, Mapping

import numpy as np

from fcsv_geometry.bags import reading
from fcsv_geometry.errors import BagError, PoseUnavailable
from fcsv_geometry.home import HomeFrames, camera_in_home
from fcsv_geometry.messages import seconds
from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import PosePrior
from fcsv_stereo.near import DepthFrame, Thinning
from fcsv_stereo.pose_covariance import KnownCovariances, turned
from fcsv_stereo.sessions.cameras import CameraTimeline
from fcsv_stereo.sessions.left_out import LeftOut
from fcsv_stereo.sessions.pictures import samples_of

#: As realsense2_camera 2.3 names depth in the colour camera's pixels; below a vehicle's namespace.
DEPTH, DEPTH_INFO = (
    "camera/aligned_depth_to_color/image_raw",
    "camera/aligned_depth_to_color/camera_info",
)
_TYPE = "sensor_msgs/Image"
_ENCODINGS = ("16UC1", "mono16")
#: Around another vehicle's place nothing is mapped: its own size (half of it 0.25 m), and how well
#: its place is known.
_VEHICLE_M = 0.6


@dataclass(frozen=True)
class RecordedDepth:
    """Where a session holds depth. ``cameras`` are those of its camera_info, by vehicle; the others
    as in the bags."""

    bags: List[Path]
    cameras: Mapping[str, CameraTimeline]
    tracks: Mapping[str, Trajectory]
    in_home: HomeFrames
    T_body_cam: Mapping[str, np.ndarray]
    covariances: Mapping[str, KnownCovariances]
    prior: PosePrior
    warnings: List[str] = field(default_factory=list)  # filled by ``frames``

    @property
    def vehicles(self) -> List[str]:
        """Those whose frames can have a pose."""
        known = (self.tracks, self.in_home.places, self.T_body_cam)
        return sorted(v for v in self.cameras if all(v in k for k in known))

    def frames(self) -> Iterator[DepthFrame]:
        """Frames that show something new (near.Thinning), bag by bag; those without a pose are
        counted in ``warnings``.

        Single frames that are none are left out. Raises InputError where all are none, naming
        topic, bag and why.
        """
        lost: Dict[str, int] = {}
        thinning, left_out, given = Thinning(), LeftOut(), 0
        for bag in self.bags:
            try:
                for frame in self._of_bag(bag, thinning, lost, left_out):
                    given += 1
                    yield frame
            except BagError as error:
                self.warnings.append(f"{error}; the depth frames that follow there are left out")
        if left_out.warnings() and not given:
            raise InputError("; ".join(left_out.warnings()))
        self.warnings.extend(left_out.warnings())
        for vehicle, count in lost.items():
            self.warnings.append(
                f"{count} depth frames of {vehicle} have no odometry at their stamp: left out"
            )

    def _of_bag(
        self, bag: Path, thinning: Thinning, lost: Dict[str, int], left_out: LeftOut
    ) -> Iterator[DepthFrame]:
        topics = {f"/{v}/{DEPTH}": v for v in self.vehicles}

        def broken(topic: str, recorded_s: float, why: str) -> None:
            left_out.add(topic, recorded_s, f"its bytes are no {_TYPE} ({why})")

        for topic, message in reading.messages(
            bag, lambda n, kind: _holds_depth(bag, topics, n, kind), broken
        ):
            vehicle, stamp_s = topics[topic], seconds(message.header.stamp)
            try:
                T_home_cam = self._camera_in_home(vehicle, stamp_s)
            except PoseUnavailable:
                lost[vehicle] = lost.get(vehicle, 0) + 1
                continue
            if thinning.takes(vehicle, stamp_s, T_home_cam):
                try:
                    yield self._frame(bag.name, vehicle, stamp_s, T_home_cam, message)
                except InputError as error:
                    left_out.add(topic, stamp_s, str(error))

    def _frame(
        self, where: str, vehicle: str, stamp_s: float, T_home_cam: np.ndarray, message
    ) -> DepthFrame:
        if message.encoding not in _ENCODINGS:
            raise InputError(
                f"{where}: encoding '{message.encoding}' is not depth in mm: {', '.join(_ENCODINGS)}"
            )
        millimetres = samples_of(where, message, 1, np.dtype(np.uint16))
        covariance = self._covariance(vehicle, stamp_s, T_home_cam)
        camera = self.cameras[vehicle].at(stamp_s)
        frame = DepthFrame.of_millimetres(
            vehicle, stamp_s, millimetres, camera, T_home_cam, covariance
        )
        return frame.without(self._others(vehicle, stamp_s), _VEHICLE_M)

    def _camera_in_home(self, vehicle: str, stamp_s: float) -> np.ndarray:
        return camera_in_home(
            self.in_home.at(stamp_s)[vehicle],
            self.tracks[vehicle].at(stamp_s),
            self.T_body_cam[vehicle],
        )

    def _covariance(self, vehicle: str, stamp_s: float, T_home_cam: np.ndarray) -> np.ndarray:
        """Gives the covariance as it was recorded, or as it is assumed of a flight."""
        known = self.covariances[vehicle].at(stamp_s) if vehicle in self.covariances else None
        if known is not None:
            return turned(known, T_home_cam[:3, :3])
        position_m = self.prior.position_sigma_m(float(np.linalg.norm(T_home_cam[:3, 3])))
        return np.diag(np.repeat([position_m, self.prior.rotation_rad], 3) ** 2)

    def _others(self, vehicle: str, stamp_s: float) -> List[np.ndarray]:
        """Places in home of the other vehicles' cameras, as far as they are known."""
        places = []
        for other in self.tracks:
            if other != vehicle and other in self.in_home.places and other in self.T_body_cam:
                try:
                    places.append(self._camera_in_home(other, stamp_s)[:3, 3])
                except PoseUnavailable:
                    continue
        return places


def _holds_depth(bag: Path, topics, name: str, kind: str) -> bool:
    if name in topics and kind != _TYPE:
        raise InputError(f"{bag}, topic {name}: is of type {kind}, not {_TYPE}")
    return name in topics
