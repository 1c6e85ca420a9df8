# SPDX-License-Identifier: Apache-2.0
"""What a guardian hears of the other vehicles over the radio, in home."""

import threading
import time
from dataclasses import replace
from typing import Dict, List, Optional, Tuple

import numpy as np
import rospy
from nav_msgs.msg import Odometry

from fcsv_control.guardian.air import Other
from fcsv_geometry import home_messages, transforms
from fcsv_geometry.arrivals import Arrivals
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.home import HomeFrames, Place
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.relay_ages import hear_ages, publisher_of
from fcsv_msgs.msg import Calibration, GuardianState, Home
from mavros_msgs.msg import State


class OtherVehicles:
    """``now`` gives where this vehicle's odometry stands in home, and the others there, as heard last; from when it was
    sent, as the relay on board measured it."""

    def __init__(self, own: str, vehicles: List[str]):
        self._own, self._lock = own, threading.Lock()
        self._arrivals = Arrivals()
        hear_ages(self._arrivals, f"/{own}")
        self._in_home = HomeFrames()
        self._heard: Dict[str, Tuple[np.ndarray, Other]] = {}  # position in its own odometry
        self._states: Dict[str, State] = {}
        self._guardians: Dict[str, GuardianState] = {}
        rospy.Subscriber("/calibration", Calibration, self._compose, home_messages.take_calibration, queue_size=1)
        rospy.Subscriber("/home", Home, self._compose, home_messages.take_home, queue_size=1)
        for name in vehicles:
            if name != own:
                rospy.Subscriber(f"/{name}/mavros/state", State, self._on_state, name, queue_size=5)
                rospy.Subscriber(f"/{name}/guardian/state", GuardianState, self._on_guardian, name, queue_size=5)
                rospy.Subscriber(f"/{name}/odometry/state", Odometry, self._on_odometry, name, queue_size=5)

    def now(self) -> Tuple[Optional[Place], Dict[str, Other]]:
        """This vehicle's odometry in home (None: not known), and each other whose place in home is known."""
        with self._lock:
            places = self._in_home.places
            found: Dict[str, Other] = {}
            for name, (p_odom, other) in self._heard.items():
                if name in places:
                    p_home = transforms.apply(places[name].T_a_b, p_odom)
                    heard_s = self._arrivals.since_s(_odometry_of(name), other.heard_s)
                    sigma_m = places[name].sigma_m(p_odom)
                    other = replace(other, p_home_m=p_home, sigma_m=sigma_m, heard_s=heard_s)
                    found[name] = other.sent(places[name].T_a_b, _going_to_m(self._guardians.get(name)))
            return places.get(self._own), found

    def _compose(self, message, take) -> None:
        with self._lock:
            try:
                take(self._in_home, message)
            except FcsvError as error:
                rospy.logerr("%s: calibration or home dropped: %s", self._own, error)

    def _on_state(self, message: State, name: str) -> None:
        if not message.mode:  # its link hears no autopilot (yet): that says nothing of its motors
            return
        with self._lock:
            self._states[name] = message
            self._renew(name)

    def _on_guardian(self, message: GuardianState, name: str) -> None:
        with self._lock:
            self._guardians[name] = message
            self._renew(name)

    def _on_odometry(self, message: Odometry, name: str) -> None:
        self._arrivals.came(_odometry_of(name), publisher_of(message))
        try:
            T_odom_body = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            rospy.logwarn_throttle(5.0, f"odometry of {name} dropped: {error}")
            return
        v = message.twist.twist.linear
        speed_mps = float(np.linalg.norm((v.x, v.y, v.z)))
        with self._lock:
            p_odom = T_odom_body[:3, 3]
            self._heard[name] = (p_odom, Other(p_odom, time.monotonic(), speed_mps))
            self._renew(name)

    def _renew(self, name: str) -> None:
        """Mode and guardian of what was heard; who has not told its mode counts as flying."""
        if name in self._heard:
            p_odom, other = self._heard[name]
            state = self._states.get(name)
            armed, mode = (True, "") if state is None else (state.armed, state.mode)
            told = self._guardians.get(name, GuardianState())
            self._heard[name] = (p_odom, replace(other, armed=armed, mode=mode).guarded(told))


def _going_to_m(told: Optional[GuardianState]) -> Optional[Tuple[float, float, float]]:
    if told is None or not told.sent:
        return None
    return told.going_to.x, told.going_to.y, told.going_to.z


def _odometry_of(name: str) -> str:
    return f"/{name}/odometry/state"
