# SPDX-License-Identifier: Apache-2.0
"""Writes the true poses of a vehicle that ArduCopter's own simulation flies: simulated sensors and
people see these."""

import time
from dataclasses import dataclass
from typing import Tuple

import rospy

from fcsv_geometry.ros import node
from fcsv_sim.autopilot.elsewhere import TrueMotion
from fcsv_sim.autopilot.simulation_line import SimulationLine, require_simulation
from fcsv_sim.truth import TruthWriter

_SILENT_S = 1.0


@dataclass(frozen=True)
class AutopilotTruthParameters:
    """Parameters of the node; ``autopilot``: tcp:HOST:PORT; start: x, y, z (m) and yaw (rad) in the
    world."""

    vehicle: str
    vehicles_dir: str
    sim_dir: str
    autopilot: str
    start_xyz_yaw: Tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


class AutopilotTruthNode:
    """Stands where ``vehicle`` stands with a simulated autopilot."""

    def __init__(self):
        p = node.parameters(AutopilotTruthParameters)
        system = node.vehicles(p.vehicles_dir, [p.vehicle])[p.vehicle].system_id
        require_simulation(p.autopilot, p.vehicle, system)
        self._name = p.vehicle
        self._line = SimulationLine(p.autopilot)
        self._motion = TrueMotion(p.start_xyz_yaw)
        self._writer = TruthWriter(p.sim_dir, p.vehicle)

    def spin(self) -> None:
        """Runs until ROS shuts the node down."""
        heard_s = time.monotonic()
        while not rospy.is_shutdown():
            message = self._line.receive(0.05)
            if message is not None and message.get_type() == "SIM_STATE":
                heard_s = time.monotonic()
                state = self._motion.on_sim_state(time.time(), message)
                self._writer.write(state.stamp_s, state.T_world_body, state.v_world_mps)
            elif time.monotonic() - heard_s > _SILENT_S:
                rospy.logwarn_throttle(
                    5.0,
                    "%s: no true pose for %.0f s from %s",
                    self._name,
                    time.monotonic() - heard_s,
                    self._line.address,
                )
        self._line.close()


def main() -> int:
    """Run the node."""
    return node.run("autopilot_truth", AutopilotTruthNode)
