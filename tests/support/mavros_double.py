#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A stand-in for MAVROS's node, for tests where it is not installed: its names, types and way of
answering.

No kinder than the real one: a mode is answered as sent, whatever becomes of it; a command goes out
once and is given up after command_ack_timeout; a second one of the same number meanwhile fails;
texts come in the pieces in which they stand on the line; a battery that is not known has a share of
-0.01.
"""

import os
import sys

os.environ.setdefault("MAVLINK20", "1")

import math
import threading
import time

import rospy
from geometry_msgs.msg import PoseStamped
from pymavlink import mavutil
from sensor_msgs.msg import BatteryState

from fcsv_control.flight.mavlink import conversion, frame_bytes
from fcsv_control.flight.mavlink.lines import UdpLine
from fcsv_control.flight.state import MODES
from fcsv_geometry.ros import conversions, node
from mavros_msgs.msg import Mavlink, RCIn, State, StatusText
from mavros_msgs.srv import (
    CommandBool,
    CommandBoolResponse,
    CommandTOL,
    CommandTOLResponse,
    SetMode,
    SetModeResponse,
)

M = mavutil.mavlink
NAMES = {number: name for name, number in MODES.items()}


class MavrosDouble:
    """Private parameters as MAVROS has them; only addresses of the form udp://HOST:PORT@."""

    def __init__(self):
        url = rospy.get_param("~fcu_url")
        self.me = rospy.get_param("~system_id"), rospy.get_param("~component_id")
        self.target = rospy.get_param("~target_system_id")
        self.ack_s = rospy.get_param("~cmd/command_ack_timeout", 5.0)
        self.frame = rospy.get_param("~local_position/frame_id", "map")
        self.line = UdpLine(url[len("udp://") : -1], listens=True)
        self.rpy, self.heard_s, self.connected, self.waits, self.armed = (
            None,
            -math.inf,
            False,
            {},
            False,
        )
        self.lock = threading.Lock()
        self.raw = rospy.Publisher("mavlink/from", Mavlink, queue_size=100)
        self.state = rospy.Publisher("~state", State, queue_size=10, latch=True)
        self.battery = rospy.Publisher("~battery", BatteryState, queue_size=10)
        self.texts = rospy.Publisher("~statustext/recv", StatusText, queue_size=10)
        self.pose = rospy.Publisher("~local_position/pose", PoseStamped, queue_size=10)
        self.rc = rospy.Publisher("~rc/in", RCIn, queue_size=10)
        self.state.publish(State())
        rospy.Service("~set_mode", SetMode, self.set_mode)
        rospy.Service(
            "~cmd/arming",
            CommandBool,
            lambda r: self.command(CommandBoolResponse, 400, float(r.value)),
        )
        take_off = lambda r: self.command(  # noqa: E731
            CommandTOLResponse, 22, r.min_pitch, 0, 0, r.yaw, 0, 0, r.altitude
        )
        rospy.Service("~cmd/takeoff", CommandTOL, take_off)
        rospy.Service("~cmd/land", CommandTOL, lambda r: self.command(CommandTOLResponse, 21))
        rospy.Subscriber("mavlink/to", Mavlink, self.send_raw, queue_size=100)
        rospy.Subscriber("~setpoint_position/local", PoseStamped, self.set_point, queue_size=10)
        threading.Thread(target=self.beat, daemon=True).start()

    # ---- towards the autopilot

    def send(self, message, source=None):
        with self.lock:
            self.line.mav.srcSystem, self.line.mav.srcComponent = source or self.me
            self.line.mav.send(message)

    def beat(self):
        while not rospy.is_shutdown():
            self.send(M.MAVLink_heartbeat_message(18, 8, 192, 0, 4, 3))
            if self.connected and time.monotonic() - self.heard_s > rospy.get_param(
                "~conn/timeout", 10.0
            ):
                self.connected = False
                self.state.publish(State())
            time.sleep(1.0)

    def send_raw(self, m):
        frame = frame_bytes.to_frame(
            m.len,
            m.incompat_flags,
            m.compat_flags,
            m.seq,
            m.sysid,
            m.compid,
            m.msgid,
            m.checksum,
            m.payload64,
            m.signature,
        )
        with self.lock:
            self.line.mav.srcSystem = m.sysid
            self.line.write(frame)

    def set_mode(self, request):
        if request.custom_mode not in MODES:
            return SetModeResponse(False)
        self.send(
            M.MAVLink_set_mode_message(
                self.target, 1 | (128 if self.armed else 0), MODES[request.custom_mode]
            )
        )
        return SetModeResponse(True)

    def command(self, response, number, *values):
        with self.lock:
            if number in self.waits:
                return None  # rospy: the service failed
            wait = self.waits[number] = [threading.Event(), 0]
        padded = [*values, *[0.0] * (7 - len(values))]
        self.send(M.MAVLink_command_long_message(self.target, 1, number, 1, *padded))
        answered = wait[0].wait(self.ack_s)
        with self.lock:
            del self.waits[number]
        return response(answered and wait[1] == 0, wait[1])

    def set_point(self, message):
        ned, (_, _, yaw) = conversion.ned_from_pose(conversions.pose_to_transform(message.pose))
        self.send(
            M.MAVLink_set_position_target_local_ned_message(
                0, self.target, 1, M.MAV_FRAME_LOCAL_NED, 0x9F8, *ned, 0, 0, 0, 0, 0, 0, yaw, 0
            )
        )

    # ---- from it

    def spin(self):
        while not rospy.is_shutdown():
            message = self.line.receive(0.05)
            if message is None or message.get_type() == "BAD_DATA":
                continue
            fields = frame_bytes.to_fields(bytes(message.get_msgbuf()))
            self.raw.publish(Mavlink(framing_status=Mavlink.FRAMING_OK, **fields))
            handle = getattr(self, "on_" + message.get_type().lower(), None)
            if handle and (message.get_srcSystem(), message.get_srcComponent()) == (self.target, 1):
                handle(message)

    def on_heartbeat(self, m):
        self.heard_s, self.connected, self.armed = time.monotonic(), True, bool(m.base_mode & 128)
        self.state.publish(
            State(
                conversions.header(rospy.get_time(), ""),
                True,
                self.armed,
                bool(m.base_mode & 8),
                bool(m.base_mode & 64),
                NAMES.get(m.custom_mode, f"CMODE({m.custom_mode})"),
                m.system_status,
            )
        )

    def on_command_ack(self, m):
        wait = self.waits.get(m.command)
        if wait:
            wait[1] = m.result
            wait[0].set()

    def on_statustext(self, m):
        self.texts.publish(StatusText(conversions.header(rospy.get_time(), ""), m.severity, m.text))

    def on_sys_status(self, m):
        self.battery.publish(
            BatteryState(voltage=m.voltage_battery / 1e3, percentage=m.battery_remaining * 0.01)
        )

    def on_rc_channels(self, m):
        channels = [getattr(m, f"chan{k + 1}_raw") for k in range(m.chancount)]
        self.rc.publish(RCIn(conversions.header(rospy.get_time(), ""), m.rssi, channels))

    def on_attitude(self, m):
        self.rpy = m.roll, m.pitch, m.yaw

    def on_local_position_ned(self, m):
        if self.rpy:
            T = conversion.pose_from_ned((m.x, m.y, m.z), self.rpy)
            self.pose.publish(conversions.pose_stamped(T, rospy.get_time(), self.frame))


if __name__ == "__main__":
    node.begin("mavros")
    MavrosDouble().spin()
    sys.exit(0)
