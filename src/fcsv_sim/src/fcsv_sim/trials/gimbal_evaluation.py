# SPDX-License-Identifier: Apache-2.0
"""A gimbal that follows a vehicle at a constant speed, two to four metres away: pictures, detector,
tracker and servos closed to a loop in simulated time, and every pose that comes out against the
truth."""

import heapq
from dataclasses import dataclass, field
from typing import Callable, List, Optional, Protocol, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_sim.gimbal.gimbal import MountErrors, ServoErrors, SimulatedGimbal
from fcsv_sim.gimbal.gimbal_camera import GimbalCamera, GimbalCameraParameters, facing
from fcsv_sim.trials.mocap_flight import STEP_HZ, TrueTrack, attitudes, vibration
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.base_motion import BaseMotion
from fcsv_tracking.gimbal.config import Gimbal
from fcsv_tracking.gimbal.looking import look
from fcsv_tracking.gimbal.tracker import GimbalRules, GimbalTracker, GroundPose
from fcsv_tracking.tags import TagDetector, TagObservation, corner_points, observation

START_S = 1000.0
READ_HZ = 100.0
# what the detector takes; the tracker hears of a picture so much after it arrived
DETECTION_S = 0.03
_LAPS = 2.0  # more of the way than the slowest part of it takes
SETTLE_S = 2.0  # until the first search is over; not judged


@dataclass(frozen=True)
class Scenario:
    """How it flies: at a constant speed to and fro in a part of a shell about the gimbal."""

    speed_mps: float = 1.0
    distance_m: Tuple[float, float] = (2.0, 4.0)
    bearing_deg: float = 60.0  # to either side
    elevation_deg: Tuple[float, float] = (-5.0, 35.0)
    duration_s: float = 20.0


@dataclass(frozen=True)
class Setup:
    """What follows it: rules, camera, servos and how they were measured in."""

    rules: GimbalRules = field(default_factory=GimbalRules)
    camera: GimbalCameraParameters = field(default_factory=GimbalCameraParameters)
    servo: ServoErrors = field(default_factory=ServoErrors)
    mount: MountErrors = field(default_factory=MountErrors)
    decimate: float = 2.0
    # above nought: no pictures are drawn, corners seen face on have this noise (long runs)
    corners_px: float = 0.0


class BodyTrack(Protocol):
    """A vehicle's true motion in the ground robot's frame."""

    def at(self, stamp_s: float) -> np.ndarray:
        """T_G_D at a moment."""


@dataclass(frozen=True)
class PoseRecord:
    """One pose given out, against the truth at its stamp: errors along and across the line of
    sight, covariance."""

    stamp_s: float
    along_m: float
    across_m: float
    angle_deg: float
    error: np.ndarray
    covariance: np.ndarray
    distance_m: float

    @property
    def normalised(self) -> float:
        """Squared error over covariance, six degrees of freedom."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error))


@dataclass
class Run:
    """All that one run gave: poses against the truth, every pose as it was given and when (s), and
    looked at once per period of the camera, whether a tag was in the picture and the gimbal
    still."""

    poses: List[PoseRecord] = field(default_factory=list)
    given: List[Tuple[float, GroundPose]] = field(default_factory=list)
    in_picture: List[bool] = field(default_factory=list)
    still: List[bool] = field(default_factory=list)
    pictures: int = 0
    tracker: Optional[GimbalTracker] = None


def fly(gimbal: Gimbal, scenario: Scenario, seed: int) -> TrueTrack:
    """The vehicle's motion in the ground robot's frame."""
    random = np.random.default_rng([seed, 23])
    fine = np.linspace(0.0, _LAPS * scenario.duration_s, 20000)
    p = _way(gimbal, scenario, fine, random)
    length_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    t = np.arange(0.0, scenario.duration_s + 1.0, 1.0 / STEP_HZ)
    along = np.stack(
        [np.interp(scenario.speed_mps * t, length_m, p[:, k]) for k in range(3)], axis=1
    )
    keep = int(STEP_HZ * 0.1)  # corners that an airframe can fly
    smooth = np.apply_along_axis(
        lambda c: np.convolve(
            np.pad(c, keep, "edge"), np.ones(2 * keep + 1) / (2 * keep + 1), "valid"
        ),
        0,
        along,
    )
    v = np.gradient(smooth, t, axis=0)
    a = np.gradient(v, t, axis=0)
    yaw = random.uniform(-np.pi, np.pi) + 0.6 * np.sin(
        2 * np.pi * 0.05 * t + random.uniform(0.0, 2 * np.pi)
    )
    R = attitudes(np.clip(a + 0.25 * v, -4.0, 4.0), yaw) @ vibration(t, random)
    return TrueTrack(START_S + t, smooth, v, R)


def _way(gimbal: Gimbal, scenario: Scenario, s: np.ndarray, random) -> np.ndarray:
    """Places (N,3) in order: distance, bearing and elevation swing within their bounds, none in
    step with another."""
    lows = np.array([scenario.distance_m[0], -scenario.bearing_deg, scenario.elevation_deg[0]])
    highs = np.array([scenario.distance_m[1], scenario.bearing_deg, scenario.elevation_deg[1]])
    rates = np.array([1.9, 1.0, 1.4]) * random.uniform(0.85, 1.15, 3)
    swing = np.sin(np.outer(s, rates) + random.uniform(0.0, 2 * np.pi, 3))
    distance, bearing, up = (0.5 * (lows + highs) + 0.5 * (highs - lows) * swing).T
    bearing, up = np.radians(bearing), np.radians(up)
    ahead = np.stack(
        [np.cos(up) * np.cos(bearing), np.cos(up) * np.sin(bearing), np.sin(up)], axis=1
    )
    return np.array(gimbal.geometry.base.xyz_m) + distance[:, None] * ahead


def run(
    gimbal: Gimbal, seed: int, scenario: Optional[Scenario] = None, setup: Optional[Setup] = None
) -> Run:
    """Follow one flight in simulated time."""
    scenario = scenario or Scenario()
    return follow(gimbal, fly(gimbal, scenario, seed), scenario.duration_s, seed, setup or Setup())


def follow(
    gimbal: Gimbal,
    truth: BodyTrack,
    duration_s: float,
    seed: int,
    setup: Setup,
    wheels: Optional[Callable[[float], Tuple[float, np.ndarray]]] = None,
) -> Run:
    """Follow a vehicle that moves as ``truth`` says from START_S on, in simulated time.

    ``wheels(now_s)``: the newest odometry of a robot that moves, (stamp, T_O_G).
    """
    loop, result = GimbalLoop(gimbal, truth, seed, setup, START_S), Run()
    result.tracker = loop.tracker
    for tick in range(int(duration_s * READ_HZ)):
        now_s = START_S + tick / READ_HZ
        looked = loop.step(now_s, None if wheels is None else wheels(now_s))
        if looked.taken_s is not None:
            _look(result, loop.eye, loop.servos, truth, looked.taken_s)
        result.pictures += len(looked.heard)
        for true_s, pose in looked.heard:
            if pose is None:
                continue
            result.given.append((now_s, pose))
            if true_s > START_S + SETTLE_S:
                result.poses.append(_record(pose, truth, loop.servos))
    return result


@dataclass(frozen=True)
class LoopPass:
    """What one pass of a loop brought: when the picture that it took was taken (None: it took none),
    and of each picture that was looked at when it was taken and its pose, None where it gave
    none."""

    taken_s: Optional[float]
    heard: List[Tuple[float, Optional[GroundPose]]]


class GimbalLoop:
    """A gimbal that follows a vehicle: servos, pictures, detector and tracker, closed to a loop in
    simulated time from ``start_s`` on. step() is called READ_HZ times a second; ``truth`` must know
    all that is past."""

    def __init__(
        self, gimbal: Gimbal, truth: BodyTrack, seed: int, setup: Setup, start_s: float = START_S
    ):
        self._truth, self._setup, self._now_s, self._tick = truth, setup, start_s, 0
        start = gimbal.geometry.aim(truth.at(start_s)[:3, 3])  # an operator shows it where to begin
        self.servos = SimulatedGimbal(
            gimbal.geometry, seed, lambda: self._now_s, setup.servo, setup.mount
        )
        self.eye = GimbalCamera(gimbal.tags, setup.camera, seed)
        detector = TagDetector({t.id: t.size_m for t in gimbal.tags}, setup.decimate)
        self._base = BaseMotion()
        self.tracker = GimbalTracker(
            gimbal.geometry, gimbal.tags, self.eye.model, setup.rules, start, self._base
        )
        self.servos.turn(start)
        self._hear = _Ear(self.tracker, detector, self.eye, self.servos, truth, setup, seed)
        self._waiting: List[tuple] = []
        self._ticks_per_picture = int(round(READ_HZ / setup.camera.rate_hz)) or 1

    def step(self, now_s: float, wheels: Optional[Tuple[float, np.ndarray]] = None) -> LoopPass:
        """One pass; ``wheels``: the newest odometry of a robot that moves, (stamp, T_O_G)."""
        self._now_s = now_s
        _read(self.tracker, self.servos)
        if wheels is not None:
            self._base.add(*wheels)
        taken_s = None
        if self._tick % self._ticks_per_picture == 0 and self._tick > 10:
            taken_s = now_s - 0.5 * self._setup.camera.exposure_s - 0.005
            heapq.heappush(self._waiting, (self.eye.arrival_s(taken_s) + DETECTION_S, taken_s))
        self._tick += 1
        heard = []
        while self._waiting and self._waiting[0][0] <= now_s:
            true_s = heapq.heappop(self._waiting)[1]
            heard.append((true_s, self._hear(true_s, now_s)))
        goal = self.tracker.command(now_s)
        if goal is not None:
            self.servos.turn(goal)
        return LoopPass(taken_s, heard)


class _Ear:
    """Pictures as they arrive; drawn only then, and only where they are looked at."""

    def __init__(self, tracker, detector, eye, servos, truth, setup: Setup, seed: int):
        self._tracker, self._detector, self._eye, self._servos, self._truth = (
            tracker,
            detector,
            eye,
            servos,
            truth,
        )
        self._corners_px, self._random = setup.corners_px, np.random.default_rng([seed, 25])

    def __call__(self, true_s: float, now_s: float) -> Optional[GroundPose]:
        stamp_s = self._eye.stamp_s(true_s)
        if self._tracker.turning(stamp_s):
            return None
        try:
            return self._tracker.add_tags(now_s, stamp_s, self._observations(true_s, stamp_s))
        except SampleRejected:
            return None  # counted in the tracker

    def _observations(self, true_s: float, stamp_s: float) -> List[TagObservation]:
        if self._corners_px > 0:
            return self._noisy(
                transforms.invert(self._servos.T_ground_cam(true_s)) @ self._truth.at(true_s)
            )
        gray = self._eye.shoot(true_s, self._servos.T_ground_cam, self._truth.at)
        return look(self._detector, gray, self._eye.model, self._tracker.window(stamp_s))[0]

    def _noisy(self, T_cam_body: np.ndarray) -> List[TagObservation]:
        found, model = [], self._eye.model
        for tag, T_cam_tag in self._eye.tags_in(T_cam_body):
            uv = model.project(transforms.apply(T_cam_tag, corner_points(tag.size_m)))
            uv += self._random.normal(0.0, self._corners_px / facing(T_cam_tag), uv.shape)
            found.append(observation(tag.id, tag.size_m, uv, model))
        return found


def _read(tracker: GimbalTracker, servos: SimulatedGimbal) -> None:
    reading = servos.read()
    try:
        tracker.add_angles(reading.stamp_s, reading.angles)
    except SampleRejected:
        pass  # counted


def _look(
    result: Run, eye: GimbalCamera, servos: SimulatedGimbal, truth: BodyTrack, true_s: float
) -> None:
    if true_s > START_S + SETTLE_S:
        T_cam_body = transforms.invert(servos.T_ground_cam(true_s)) @ truth.at(true_s)
        result.in_picture.append(bool(eye.tags_in(T_cam_body)))
        result.still.append(servos.still)


def _record(pose, truth: BodyTrack, servos: SimulatedGimbal) -> PoseRecord:
    """Errors at the stamp that the pose bears: a stamp that is wrong is an error of the pose."""
    T = truth.at(pose.stamp_s)
    off = pose.T_G_D[:3, 3] - T[:3, 3]
    sight = T[:3, 3] - servos.T_ground_cam(pose.stamp_s)[:3, 3]
    distance_m = float(np.linalg.norm(sight))
    along = float(off @ sight / distance_m)
    turn = Rotation.from_matrix(pose.T_G_D[:3, :3] @ T[:3, :3].T).as_rotvec()
    across = float(np.sqrt(max(0.0, off @ off - along**2)))
    error = np.concatenate([off, turn])
    return PoseRecord(
        pose.stamp_s,
        along,
        across,
        float(np.degrees(np.linalg.norm(turn))),
        error,
        pose.covariance,
        distance_m,
    )
