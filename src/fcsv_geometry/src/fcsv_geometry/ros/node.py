# SPDX-License-Identifier: Apache-2.0
"""What every node begins with: strict parameters, the core's log in rosout, one line where it
cannot run."""

import dataclasses
import logging
import traceback
from typing import Any, Callable, Dict, Sequence, Type, TypeVar

import rospy

from fcsv_geometry import config
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import publishers
from fcsv_geometry.vehicles.vehicle import VehicleGeometry, load_vehicles

T = TypeVar("T")
CANNOT_RUN = 2
_LOG_EVERY_S = 5.0


def begin(name: str, **how) -> None:
    """``rospy.init_node`` of a process of this workspace: it forgets no publisher
    (publishers.py)."""
    publishers.keep_all()
    rospy.init_node(name, **how)


def run(name: str, make: Callable[[], Any]) -> int:
    """Make the node and spin until ROS shuts it down; its exit status.

    ``make`` reads parameters and subscribes; its result's ``spin()`` is used where it has one. An
    FcsvError from it is the end, as one line.
    """
    begin(name)
    _log_to_rosout()
    try:
        node = make()
    except FcsvError as error:
        rospy.logfatal("%s", error)
        return CANNOT_RUN
    try:
        getattr(node, "spin", rospy.spin)()
    except rospy.ROSException:  # "publish() to a closed topic", and interrupted sleep
        if not rospy.is_shutdown():
            raise
    return 0


def every(period_s: float, work: Callable[[Any], None]) -> rospy.Timer:
    """Call ``work`` with the timer's event again and again, in a thread of its own, until ROS shuts
    the node down.

    A defect in it costs one turn and is logged; rospy's own timer would end without a word, as it
    would where simulated time goes back.
    """

    def turn(event) -> None:
        try:
            work(event)
        except Exception:
            # topics are closed from then on, before is_shutdown()
            if not rospy.core.is_shutdown_requested():
                rospy.logerr_throttle(_LOG_EVERY_S, f"{rospy.get_name()}: {traceback.format_exc()}")

    return rospy.Timer(rospy.Duration(period_s), turn, reset=True)


def defect(error: Exception) -> str:
    """Call where an exception that nobody expected is caught: its traceback goes to the log, the
    words to the user."""
    rospy.logerr("%s", traceback.format_exc())
    return f"a defect of this program ({error}); see its log"


def parameters(cls: Type[T]) -> T:
    """The node's private parameters as a frozen dataclass. Raises ConfigError naming node and
    parameter; logs them."""
    name = rospy.get_name()
    found = config.from_mapping(rospy.get_param(name, {}), cls, name)
    rospy.loginfo("%s: %s", name, dataclasses.asdict(found))
    return found


def vehicles(folder: str, names: Sequence[str]) -> Dict[str, VehicleGeometry]:
    """The vehicles named, in order. Raises ConfigError; also on an empty list."""
    if not names:
        raise config.ConfigError(
            f"{rospy.get_name()}: 'vehicles' is empty; name the column, front first"
        )
    return load_vehicles(folder, list(dict.fromkeys(names)))


def _log_to_rosout() -> None:
    """What the packages of this workspace log goes where the node's own messages go."""
    for package in ("geometry", "tracking", "stereo", "guidance", "control", "multimaster", "sim"):
        logger = logging.getLogger(f"fcsv_{package}")
        logger.setLevel(logging.INFO)
        logger.propagate = False
        for handler in logging.getLogger("rosout").handlers:
            logger.addHandler(handler)
