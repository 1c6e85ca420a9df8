# SPDX-License-Identifier: Apache-2.0
"""The simulated colour camera under realsense2_camera's topic and frame names."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import List, Tuple

import cv2
import rospy
from sensor_msgs.msg import CameraInfo, Image

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicle import load_vehicles
from fcsv_msgs.msg import RecorderStatus
from fcsv_sim.camera import CameraParameters, Shot, SimulatedCamera
from fcsv_sim.render.bodies import Body
from fcsv_sim.render.renderer import Renderer, require_samples
from fcsv_sim.truth import TruthReader
from fcsv_sim.world.town import Town

#: Pictures are of a moment that just passed: the truth on both sides of it is there.
_LATENCY_S = 0.02
_HEADER = "stamp_s,vehicle,x,y,z,qx,qy,qz,qw\n"


@dataclass(frozen=True)
class CameraNodeParameters:
    """As given to the node. Pictures have ``samples`` (as in Renderer) while this vehicle's recorder takes pictures,
    ``preview_samples`` while it says that it does not, ``samples`` where there is no recorder."""

    vehicle: str
    vehicles: Tuple[str, ...]
    vehicles_dir: str
    sim_dir: str
    seed: int = 1
    rate_hz: float = 6.0
    samples: int = 3
    preview_samples: int = 1

    def __post_init__(self):
        if self.rate_hz <= 0:
            raise ValueError(f"rate_hz: {self.rate_hz} must be positive")
        require_samples(self.samples)
        require_samples(self.preview_samples)


class CameraNode:
    """One picture a period; a period that is missed is skipped."""

    def __init__(self, parameters: CameraNodeParameters):
        rospy.loginfo("%s", parameters)
        self._parameters = parameters
        name = parameters.vehicle
        geometries = load_vehicles(parameters.vehicles_dir, {*parameters.vehicles, name})
        self._others: List = [(g, TruthReader(parameters.sim_dir, n)) for n, g in geometries.items() if n != name]
        self._truth = TruthReader(parameters.sim_dir, name)
        cv2.setNumThreads(1)  # the machine is shared with everything that flies
        renderer = Renderer(Town.generate(parameters.seed))
        seed = parameters.seed * 1000 + geometries[name].system_id
        self._camera = SimulatedCamera(renderer, geometries[name].T_body_cam, CameraParameters(), seed)
        self._frame = f"{name}/camera_color_optical_frame"
        self._notes = self._open_notes()
        self._health = Health(name, {"pictures": 0.5 * parameters.rate_hz})
        self._pictures = rospy.Publisher("camera/color/image_raw", Image, queue_size=2)
        self._infos = rospy.Publisher("camera/color/camera_info", CameraInfo, queue_size=2)
        self._samples = parameters.samples
        rospy.Subscriber("recorder/status", RecorderStatus, self._on_recorder, queue_size=1)

    def _on_recorder(self, message: RecorderStatus) -> None:
        self._samples = self._parameters.samples if message.pictures_on else self._parameters.preview_samples

    def spin(self) -> None:
        """Take pictures at the wished rate, or as fast as it goes."""
        period_s = 1.0 / self._parameters.rate_hz
        due_s = time.time()
        while not rospy.is_shutdown():
            now_s = time.time()
            if now_s < due_s:
                time.sleep(due_s - now_s)
            missed = max(0, int((time.time() - due_s) / period_s))
            due_s += (missed + 1) * period_s
            try:
                self._take(time.time() - _LATENCY_S)
            except PoseUnavailable as error:
                self._health.drop("no truth", str(error))
                time.sleep(0.1)

    def _take(self, stamp_s: float) -> None:
        started_s = time.perf_counter()
        T_world_body = self._truth.wait_for(stamp_s)
        shot = self._camera.shoot(stamp_s, T_world_body, self._others_at(stamp_s), self._samples)
        self._note(shot)
        self._infos.publish(conversions.info_from_camera(self._camera.model, stamp_s, self._frame))
        self._pictures.publish(conversions.array_to_image(shot.rgb, "rgb8", stamp_s, self._frame))
        self._health.tick("pictures")
        self._health.value("time per picture [ms]", f"{(time.perf_counter() - started_s) * 1e3:.0f}")

    def _others_at(self, stamp_s: float) -> List[Body]:
        """Bodies of the other vehicles; one without truth is not there."""
        bodies = []
        for geometry, truth in self._others:
            try:
                bodies.append(Body(geometry, truth.wait_for(stamp_s)))
            except PoseUnavailable:
                continue
        return bodies

    def _open_notes(self):
        path = Path(self._parameters.sim_dir) / f"truth_cameras_{self._parameters.vehicle}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        notes = open(path, "a", buffering=1)
        if notes.tell() == 0:
            notes.write(_HEADER)
        return notes

    def _note(self, shot: Shot) -> None:
        """The truth, before the picture leaves: no recorded picture is without it. The stamp as ROS rounds it."""
        stamp = rospy.Time.from_sec(shot.stamp_s)
        values = [*shot.T_world_cam[:3, 3], *transforms.quaternion_xyzw(shot.T_world_cam)]
        row = ",".join(f"{v:.9f}" for v in values)
        self._notes.write(f"{stamp.secs}.{stamp.nsecs:09d},{self._parameters.vehicle},{row}\n")


def main() -> None:
    """Run the node."""
    rospy.init_node("camera")
    CameraNode(
        CameraNodeParameters(
            vehicle=rospy.get_param("~vehicle"),
            vehicles=tuple(rospy.get_param("~vehicles")),
            vehicles_dir=rospy.get_param("~vehicles_dir"),
            sim_dir=rospy.get_param("~sim_dir"),
            seed=int(rospy.get_param("~seed", CameraNodeParameters.seed)),
            rate_hz=float(rospy.get_param("~rate_hz", CameraNodeParameters.rate_hz)),
            samples=int(rospy.get_param("~samples", CameraNodeParameters.samples)),
            preview_samples=int(rospy.get_param("~preview_samples", CameraNodeParameters.preview_samples)),
        )
    ).spin()
