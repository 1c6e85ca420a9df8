# SPDX-License-Identifier: Apache-2.0
"""The simulated vehicle as a process: real time, no topics (its voice is MAVLink)."""

import time
from dataclasses import dataclass
from typing import Tuple

import rospy

from fcsv_geometry.ros import node
from fcsv_sim.autopilot.ground import READY_S
from fcsv_sim.vehicles.vehicle import SimulatedVehicle, VehicleParameters


@dataclass(frozen=True)
class VehicleNodeParameters:
    """Parameters of the node; start: x, y, z (m) and yaw (rad) in the world. ``ready_s``: until its
    autopilot may be armed."""

    vehicle: str
    vehicles_dir: str
    sim_dir: str
    mavlink_port: int = 14550
    rc_port: int = 5501
    seed: int = 1
    start_xyz_yaw: Tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    wind_mps: float = 1.0
    signing_key: str = ""
    gps: bool = False
    ready_s: float = READY_S


class VehicleNode:
    """Keeps a simulated vehicle at the time of the clock."""

    def __init__(self):
        p = node.parameters(VehicleNodeParameters)
        system_id = node.vehicles(p.vehicles_dir, [p.vehicle])[p.vehicle].system_id
        companion = f"127.0.0.1:{p.mavlink_port}"
        parameters = VehicleParameters(
            p.vehicle,
            system_id,
            p.sim_dir,
            companion,
            p.rc_port,
            p.seed,
            p.start_xyz_yaw,
            p.wind_mps,
            p.ready_s,
            signing_key=p.signing_key,
            gps=p.gps,
        )
        self._vehicle = SimulatedVehicle(parameters, time.time())

    def spin(self) -> None:
        """Runs until ROS shuts the node down."""
        while not rospy.is_shutdown():
            self._vehicle.advance_to(time.time())
            time.sleep(max(0.001, self._vehicle.next_pass_s - time.time()))
        self._vehicle.close()


def main() -> int:
    """Run the node."""
    return node.run("sim_vehicle", VehicleNode)
