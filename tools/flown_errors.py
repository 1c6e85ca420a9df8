# SPDX-License-Identifier: Apache-2.0
"""A flown session again with other errors of its trackers and of its calibration: what another day
would have brought.

The pictures and the true poses stay. A simulated T265 with another seed goes along each vehicle's
true way from the calibration on; the calibration's error is drawn from the covariance that it
states. What the session states of its poses stays, too: it follows from the way, not from the
errors.
"""

from dataclasses import replace
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np
import rosbag

from fcsv_geometry import transforms
from fcsv_geometry.home import Place
from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicles.tracker import TrackerProfile
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_sim.sensors.t265 import T265
from fcsv_stereo.evaluating.truth import Truth
from fcsv_stereo.joint.method import choose_pictures
from fcsv_stereo.model import MapInput, Picture
from fcsv_stereo.pose_covariance import relative, relative_common
from fcsv_tracking.ros import link_messages

_NO_ERRORS = TrackerProfile(
    scale=0.0,
    walk_m_per_sqrt_m=0.0,
    heading_deg_per_sqrt_m=0.0,
    level_deg=0.0,
    position_noise_m=0.0,
    attitude_noise_deg=0.0,
)


class FlownErrors:
    """Draws of a session's pose errors; two vehicles, the reference first in the calibration."""

    def __init__(
        self, session: Path, given: MapInput, truth: Truth, vehicles: Dict[str, VehicleGeometry]
    ):
        with rosbag.Bag(str(session / "control.bag")) as bag:
            messages = [m for _, m, _ in bag.read_messages(topics=["/calibration"])]
        begun_s = messages[-1].header.stamp.to_sec()
        (link,) = (link_messages.from_message(k) for k in messages[-1].links)
        self._child, self._given, self._vehicles = link.child, given, vehicles
        self._ways = {n: _way(truth, n, v, begun_s) for n, v in vehicles.items()}
        odometry = _last_before(
            session / f"{link.child}.bag", f"/{link.child}/odometry/body", begun_s
        )
        self._link_covariance = Place(link.T_parent_child, link.covariance).at(odometry[:3, 3])
        reference = given.configurations[0].references[0]
        T_world_cam = truth.T_world_cam(reference.vehicle, reference.stamp_s)
        self._T_home_world = transforms.level(reference.T_home_cam @ transforms.invert(T_world_cam))

    def draw(self, seed: int) -> MapInput:
        """The session's input with poses as they would have been, by ``seed``."""
        random = np.random.default_rng([seed, 20])
        error = random.multivariate_normal(np.zeros(4), self._link_covariance)
        T_home_cam: Dict[Tuple[str, int], np.ndarray] = {}
        for name, way in self._ways.items():
            T_world_odom, poses = self._tracked(name, way, int(random.integers(1 << 30)))
            if name == self._child:
                T_world_odom = transforms.from_xyz_yaw(
                    T_world_odom[:3, 3] + error[:3], transforms.yaw(T_world_odom) + error[3]
                )
            T_home_odom = self._T_home_world @ T_world_odom
            for stamp_ms, T_odom_body in poses.items():
                T_home_cam[name, stamp_ms] = (
                    T_home_odom @ T_odom_body @ self._vehicles[name].T_body_cam
                )

        def posed(p: Picture) -> Picture:
            keys = [(p.vehicle, round(p.stamp_s * 1000) + k) for k in (0, -1, 1)]
            return replace(p, T_home_cam=next(T_home_cam[k] for k in keys if k in T_home_cam))

        configurations = [
            replace(
                c, references=[posed(p) for p in c.references], others=[posed(p) for p in c.others]
            )
            for c in self._given.configurations
        ]
        return replace(self._given, configurations=configurations)

    def _tracked(self, name: str, way: List[Tuple[float, np.ndarray]], seed: int):
        """Where the odometry begins in the world, level as it should be, and T_odom_body by stamp
        in milliseconds."""
        T_body_t265 = self._vehicles[name].T_body_t265
        exact, tracker = (T265(e, T_body_t265, seed) for e in (_NO_ERRORS, TrackerProfile()))
        begun_s, first = way[0]
        T_world_odom = first @ T_body_t265 @ transforms.invert(exact.odometry(begun_s, first)[0])
        T_t265_body = transforms.invert(T_body_t265)
        return T_world_odom, {
            round(s * 1000): tracker.odometry(s, T)[0] @ T_t265_body for s, T in way
        }


def _way(
    truth: Truth, name: str, vehicle: VehicleGeometry, begun_s: float
) -> List[Tuple[float, np.ndarray]]:
    """True poses of the body from the calibration on, at the stamps of its pictures: five in a
    second."""
    T_cam_body = transforms.invert(vehicle.T_body_cam)
    of = sorted((ms, T) for (vehicle_name, ms), T in truth.cameras.items() if vehicle_name == name)
    return [(ms / 1000.0, T @ T_cam_body) for ms, T in of if ms >= 1000.0 * begun_s]


def _last_before(path: Path, topic: str, stamp_s: float) -> np.ndarray:
    """T_odom_body at a time."""
    found = None
    with rosbag.Bag(str(path)) as bag:
        for _, message, _ in bag.read_messages(topics=[topic]):
            if message.header.stamp.to_sec() > stamp_s and found is not None:
                break
            found = message
    return conversions.pose_to_transform(found.pose.pose)


def prior_scale(given: MapInput, truth: Truth) -> Tuple[float, float]:
    """Error of the scale that a session's priors give all baselines together, and its stated sigma,
    as shares.

    Baselines weighed each by its own covariance, as refinement does: pictures tell all but the
    scale.
    """
    reference, others = choose_pictures(given.configurations)
    T_ref_world = transforms.invert(truth.T_world_cam(reference.vehicle, reference.stamp_s))
    n = len(others)
    true_m, error_m, stated, weight = (
        np.zeros(3 * n),
        np.zeros(3 * n),
        np.zeros((3 * n,) * 2),
        np.zeros((3 * n,) * 2),
    )
    for i, o in enumerate(others):
        own = slice(3 * i, 3 * i + 3)
        true = (
            reference.T_home_cam[:3, :3]
            @ (T_ref_world @ truth.T_world_cam(o.vehicle, o.stamp_s))[:3, 3]
        )
        true_m[own], error_m[own] = true, o.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3] - true
        for j, other in enumerate(others):
            covariance = relative(reference, o) if i == j else relative_common(reference, o, other)
            stated[own, 3 * j : 3 * j + 3] = covariance[:3, :3]
        weight[own, own] = np.linalg.inv(stated[own, own])
    gain = weight @ true_m / (true_m @ weight @ true_m)
    return float(gain @ error_m), float(np.sqrt(gain @ stated @ gain))
