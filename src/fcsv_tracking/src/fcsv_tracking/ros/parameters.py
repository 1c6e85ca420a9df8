# SPDX-License-Identifier: Apache-2.0
"""A node's private parameters as a frozen dataclass: unknown names and values out of range are refused."""

import dataclasses
from typing import Dict, List, Type, TypeVar

import rospy

from fcsv_geometry import config
from fcsv_geometry.vehicle import VehicleGeometry, load_vehicles

T = TypeVar("T")


def read(cls: Type[T]) -> T:
    """The node's parameters. Raises ConfigError naming node and parameter; logs the resolved values."""
    name = rospy.get_name()
    parameters = config.from_mapping(rospy.get_param(name, {}), cls, name)
    rospy.loginfo("%s: %s", name, dataclasses.asdict(parameters))
    return parameters


def vehicles(folder: str, names: List[str]) -> Dict[str, VehicleGeometry]:
    """The vehicles named, in order. Raises ConfigError; also on an empty list."""
    if not names:
        raise config.ConfigError(f"{rospy.get_name()}: 'vehicles' is empty; name the column, front first")
    return load_vehicles(folder, names)
