# SPDX-License-Identifier: Apache-2.0
"""The simulated V120 Duo under mocap_optitrack's topics: /mocap/NAME/pose, and
/mocap/NAME/ground_pose."""

import time
from collections import deque
from dataclasses import dataclass
from typing import Deque, Dict, List, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import Pose2D, PoseStamped

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.ros import conversions, node
from fcsv_sim.sensors.v120_duo import FRAME_RATE_HZ, StreamedBody, V120Duo, V120DuoErrors
from fcsv_sim.trials.mocap_flight import MOCAP_DELAY_S
from fcsv_sim.truth import TruthReader

Vector3 = Tuple[float, float, float]


@dataclass(frozen=True)
class MocapNodeParameters:
    """Parameters of the node; the tracker stands at ``xyz_m`` and ``rpy_deg`` in the world, x out
    of its lenses."""

    vehicles: List[str]
    sim_dir: str
    xyz_m: Vector3 = (0.0, 0.0, 0.3)
    rpy_deg: Vector3 = (0.0, -45.0, 0.0)  # looking up (thesis 5.7)
    frame: str = "mocap"
    rate_hz: float = 200.0
    seed: int = 1
    swaps_per_s: float = 0.02
    flips_per_s: float = 0.005

    def __post_init__(self):
        if not 1.0 <= self.rate_hz <= 200.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 1..200")


class MocapNode:
    """Frames at 120 Hz, their poses at up to 200 Hz: a frame is published again where none is
    newer."""

    def __init__(self):
        p = self._parameters = node.parameters(MocapNodeParameters)
        errors = V120DuoErrors(swaps_per_s=p.swaps_per_s, flips_per_s=p.flips_per_s)
        self._duo = V120Duo(errors, transforms.from_xyz_rpy(p.xyz_m, np.radians(p.rpy_deg)), p.seed)
        self._truths = {n: TruthReader(p.sim_dir, n) for n in p.vehicles}
        self._frames: Deque[Tuple[float, Dict[str, StreamedBody]]] = deque()
        self._frame_s = time.time()
        self._poses = {
            n: rospy.Publisher(f"/mocap/{n}/pose", PoseStamped, queue_size=50) for n in p.vehicles
        }
        self._places = {
            n: rospy.Publisher(f"/mocap/{n}/ground_pose", Pose2D, queue_size=50) for n in p.vehicles
        }

    def spin(self) -> None:
        """Runs until ROS shuts the node down."""
        due_s = time.time()
        while not rospy.is_shutdown():
            due_s = max(due_s + 1.0 / self._parameters.rate_hz, time.time() - 0.05)
            time.sleep(max(0.0, due_s - time.time()))
            self._expose(due_s - MOCAP_DELAY_S / 2)
            # its own clock: that this process was kept waiting is no delay of the tracker's
            self._publish(due_s)

    def _expose(self, until_s: float) -> None:
        self._frame_s = max(self._frame_s, until_s - 0.1)
        while self._frame_s + 1.0 / FRAME_RATE_HZ <= until_s:
            self._frame_s += 1.0 / FRAME_RATE_HZ
            bodies = {}
            for name, truth in self._truths.items():
                try:
                    bodies[name] = truth.at(self._frame_s)
                except PoseUnavailable:
                    continue  # that vehicle is not there yet
            self._frames.append(
                (self._frame_s + MOCAP_DELAY_S, self._duo.frame(self._frame_s, bodies))
            )

    def _publish(self, now_s: float) -> None:
        while len(self._frames) > 1 and self._frames[1][0] <= now_s:
            self._frames.popleft()
        if not self._frames or self._frames[0][0] > now_s:
            return
        for name, sight in self._frames[0][1].items():
            p = sight.T_M_D[:3, 3]
            self._poses[name].publish(
                conversions.pose_stamped(sight.T_M_D, now_s, self._parameters.frame)
            )
            self._places[name].publish(Pose2D(p[0], p[1], transforms.yaw(sight.T_M_D)))


def main() -> int:
    """Run the node."""
    return node.run("sim_mocap", MocapNode)
