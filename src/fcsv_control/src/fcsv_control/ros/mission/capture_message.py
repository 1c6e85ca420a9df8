# SPDX-License-Identifier: Apache-2.0
"""A recording window as /mission/capture says it."""

import rospy

from fcsv_control.mission.port import Captured
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import Capture, Configuration


def capture_message(mission: Mission, captured: Captured) -> Capture:
    """What /mission/capture says of a recording: in the time of day, by which pictures are
    stamped."""
    window, wall_offset_s = captured.window, captured.wall_offset_s
    c = mission.configurations[window.index]
    viewpoint = mission.viewpoint(window.index)
    axis = Configuration.HORIZONTAL if c.axis == "horizontal" else Configuration.VERTICAL
    return Capture(
        header=conversions.header(rospy.get_time(), ""),
        index=window.index,
        configuration=Configuration(c.title, axis, c.baseline_m, c.tilt_rad, c.record_s),
        reference=mission.reference,
        vehicle=window.vehicle,
        start=rospy.Time.from_sec(window.start_s + wall_offset_s),
        stop=rospy.Time.from_sec(window.stop_s + wall_offset_s),
        station=viewpoint.station if mission.stations else "",
        heading_rad=viewpoint.heading_rad,
        calibrated=rospy.Time.from_sec(captured.calibrated_s),
        position_error_m=window.position_error_m,
    )
