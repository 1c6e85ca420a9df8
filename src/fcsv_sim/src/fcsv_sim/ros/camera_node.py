# SPDX-License-Identifier: Apache-2.0
"""The simulated colour camera under realsense2_camera's topic and frame names."""

import math
import threading
import time
from dataclasses import dataclass, field, replace
from typing import List, Optional

import rospy
from sensor_msgs.msg import CameraInfo, Image

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.camera_file import read_camera
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_msgs.msg import RecorderStatus
from fcsv_sim.render.renderer import require_samples
from fcsv_sim.sensors import trigger
from fcsv_sim.sensors.camera import CameraParameters, Shot
from fcsv_sim.sensors.depth_camera import DepthParameters, SimulatedDepth
from fcsv_sim.sensors.photographer import Photographer
from fcsv_sim.world.town import Town
from fcsv_stereo.near import DepthSensor

#: Pictures are of a moment that just passed: the truth on both sides of it is there.
_LATENCY_S = 0.02
_LEAST_GAP = 0.6  # of a period between two pictures, also after a late one
_LATE = 0.25  # of a period; after a picture that begins later, some are made quickly
_CATCH_UP = 3


@dataclass(frozen=True)
class CameraNodeParameters:
    """Holds the parameters as given to the node. Pictures have ``samples`` (as in Renderer) while
    this vehicle's recorder takes pictures, ``preview_samples`` while it says that it does not,
    ``samples`` where there is no recorder.

    The rate goes before the finish: a machine that falls behind gets some pictures of
    ``preview_samples``.
    """

    vehicle: str
    vehicles: List[str]
    vehicles_dir: str
    sim_dir: str
    seed: int = 1
    world: str = "street"
    rate_hz: float = 6.0
    samples: int = 3
    preview_samples: int = 1
    preview_rate_hz: Optional[float] = None  # while the recorder takes no pictures; none: as always
    movers: bool = False  # a car and a walker move through the town
    near: bool = False  # also depth, in the pictures' pixels
    near_rate_hz: float = 2.0  # of depth, at most that of the pictures
    # file of the camera that is simulated (calibrate_camera); empty: as ``camera`` says
    calibration: str = ""
    robot: str = ""  # file of the robot that is in the place: it wears the tags named there
    camera: CameraParameters = field(default_factory=CameraParameters)

    def __post_init__(self):
        for name in ("rate_hz", "near_rate_hz"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name}: {getattr(self, name)} must be positive")
        if self.preview_rate_hz is not None and self.preview_rate_hz <= 0:
            raise ValueError(f"preview_rate_hz: {self.preview_rate_hz} must be positive")
        require_samples(self.samples)
        require_samples(self.preview_samples)


class CameraNode:
    """One picture a period, in phase with the other vehicles' cameras; a period that is missed is
    skipped."""

    def __init__(self):
        parameters = self._parameters = node.parameters(CameraNodeParameters)
        name = parameters.vehicle
        p = parameters
        town = Town.generate(p.seed, p.world)
        shape = replace(p.camera, lens=read_camera(p.calibration)[1]) if p.calibration else p.camera
        self._camera = Photographer(
            name, p.vehicles, p.vehicles_dir, p.sim_dir, town, p.seed, shape, p.movers, p.robot
        )
        self._frame = f"{name}/camera_color_optical_frame"
        self._health = Health(name, {"pictures": 0.5 * parameters.rate_hz})
        self._pictures = rospy.Publisher("camera/color/image_raw", Image, queue_size=2)
        self._infos = rospy.Publisher("camera/color/camera_info", CameraInfo, queue_size=2)
        self._depth = _DepthPublisher(p, self._camera.model, self._frame) if p.near else None
        self._samples = parameters.samples
        self._rate_hz, self._rate_changed = parameters.rate_hz, threading.Event()
        self._catch_up = 0
        rospy.Subscriber("recorder/status", RecorderStatus, self._on_recorder, queue_size=1)

    def _on_recorder(self, message: RecorderStatus) -> None:
        p = self._parameters
        self._samples = p.samples if message.pictures_on else p.preview_samples
        rate_hz = p.rate_hz if message.pictures_on else p.preview_rate_hz or p.rate_hz
        if rate_hz != self._rate_hz:
            self._rate_hz = rate_hz
            self._rate_changed.set()

    def spin(self) -> None:
        """Take pictures at the wished rate, or as fast as it goes."""
        due_s, taken_s = time.time(), -math.inf
        while not rospy.is_shutdown():
            now_s = time.time()
            if now_s < due_s and self._rate_changed.wait(due_s - now_s):
                self._rate_changed.clear()
                due_s = self._due(taken_s)
                continue
            period_s, started_s = 1.0 / self._rate_hz, time.time()
            stamp_s = trigger.newest(started_s - _LATENCY_S, self._rate_hz)
            if stamp_s <= taken_s:  # the rate just fell
                due_s = self._due(taken_s)
                continue
            self._catch_up = (
                _CATCH_UP if started_s - due_s > _LATE * period_s else max(0, self._catch_up - 1)
            )
            taken_s = stamp_s
            try:
                self._photograph(taken_s)
            except PoseUnavailable as error:
                self._health.drop("no truth", str(error))
                time.sleep(0.1)
            due_s = max(self._due(taken_s), started_s + _LEAST_GAP * period_s)

    def _due(self, taken_s: float) -> float:
        """When the picture after the one of ``taken_s`` is to be made."""
        return (
            trigger.after(max(taken_s, time.time() - 1.0 / self._rate_hz), self._rate_hz)
            + _LATENCY_S
        )

    def _photograph(self, stamp_s: float) -> None:
        started_s = time.perf_counter()
        samples = self._parameters.preview_samples if self._catch_up else self._samples
        shot = self._camera.photograph(stamp_s, samples)
        self._infos.publish(conversions.info_from_camera(self._camera.model, stamp_s, self._frame))
        self._pictures.publish(conversions.array_to_image(shot.rgb, "rgb8", stamp_s, self._frame))
        if self._depth is not None:
            self._depth.on_shot(shot)
        self._health.tick("pictures")
        self._health.value(
            "time per picture [ms]", f"{(time.perf_counter() - started_s) * 1e3:.0f}"
        )


class _DepthPublisher:
    """Depth of some of the pictures, as realsense2_camera aligns it with the colour camera's."""

    def __init__(self, parameters: CameraNodeParameters, camera: PinholeCamera, frame: str):
        own = load_vehicles(parameters.vehicles_dir, [parameters.vehicle])[parameters.vehicle]
        seed = parameters.seed * 1000 + own.system_id
        self._measured = SimulatedDepth(camera, seed, DepthSensor(), DepthParameters())
        self._camera, self._frame, self._stamp_s = camera, frame, -math.inf
        self._period_s = 1.0 / parameters.near_rate_hz - 0.5 / parameters.rate_hz
        self._images = rospy.Publisher(
            "camera/aligned_depth_to_color/image_raw", Image, queue_size=2
        )
        self._infos = rospy.Publisher(
            "camera/aligned_depth_to_color/camera_info", CameraInfo, queue_size=2
        )

    def on_shot(self, shot: Shot) -> None:
        """A picture that was just taken."""
        if shot.stamp_s - self._stamp_s < self._period_s:
            return
        self._stamp_s = shot.stamp_s
        millimetres = self._measured.measure(shot.depth, shot.rgb)
        self._infos.publish(conversions.info_from_camera(self._camera, shot.stamp_s, self._frame))
        self._images.publish(
            conversions.array_to_image(millimetres, "16UC1", shot.stamp_s, self._frame)
        )


def main() -> int:
    """Run the node."""
    return node.run("camera", CameraNode)
