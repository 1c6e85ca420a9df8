# SPDX-License-Identifier: Apache-2.0
"""The simulated vehicle as a process: real time, no topics (its voice is MAVLink)."""

import time

import rospy

from fcsv_geometry.vehicle import load_vehicles
from fcsv_sim.vehicle import PASS_S, SimulatedVehicle, VehicleParameters


def main() -> None:
    """Run until ROS shuts the node down."""
    rospy.init_node("sim_vehicle")
    name = rospy.get_param("~vehicle")
    geometry = load_vehicles(rospy.get_param("~vehicles_dir"), [name])[name]
    parameters = VehicleParameters(
        name=name,
        system_id=geometry.system_id,
        sim_dir=rospy.get_param("~sim_dir"),
        companion=f"127.0.0.1:{rospy.get_param('~mavlink_port', 14550)}",
        rc_port=rospy.get_param("~rc_port", 5501),
        seed=rospy.get_param("~seed", 1),
        start_xyz_yaw=tuple(float(x) for x in rospy.get_param("~start_xyz_yaw", [0, 0, 0, 0])),
        wind_mps=float(rospy.get_param("~wind_mps", 1.0)),
    )
    rospy.loginfo("%s", parameters)
    vehicle = SimulatedVehicle(parameters, time.time())
    while not rospy.is_shutdown():
        vehicle.advance_to(time.time())
        time.sleep(PASS_S / 2)
    vehicle.close()
