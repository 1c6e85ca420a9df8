# SPDX-License-Identifier: Apache-2.0
"""Becomes MAVROS's own node, with this vehicle's address and ids; says what is missing where it is
not installed."""

import argparse
import os
import sys
from pathlib import Path
from typing import List

from roslib.packages import find_node
from rospkg import ResourceNotFound

from fcsv_control.errors import ControlError, LinkError
from fcsv_control.flight.mavros import COMPONENT, mavros_url
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.vehicles.vehicle import load_vehicles


def mavros_node() -> str:
    """Path of MAVROS's program. Raises LinkError where it is not installed."""
    try:
        found = find_node("mavros", "mavros_node")
    except ResourceNotFound as error:
        raise LinkError(
            "flight_link:=mavros needs MAVROS, which is not installed here; on Noetic: "
            "apt install ros-noetic-mavros; else leave out flight_link:=mavros"
        ) from error
    if not found:
        raise LinkError(
            "the package mavros is here, but not its program mavros_node: build or install MAVROS"
        )
    return found[0]


def arguments(fcu_url: str, system_id: int) -> List[str]:
    """MAVROS's private parameters: it speaks with its vehicle's system id, as a companion does."""
    return [
        f"_fcu_url:={mavros_url(fcu_url)}",
        "_gcs_url:=",
        f"_system_id:={system_id}",
        f"_component_id:={COMPONENT}",
        f"_target_system_id:={system_id}",
        "_target_component_id:=1",
        "_fcu_protocol:=v2.0",
    ]


def main() -> int:
    """The exit status where MAVROS cannot be started; else this process is MAVROS from here on."""
    ours = [a for a in sys.argv[1:] if ":=" not in a]
    parser = argparse.ArgumentParser(prog="mavros", description=__doc__)
    parser.add_argument("--vehicle", required=True)
    parser.add_argument("--vehicles-dir", required=True, type=Path)
    parser.add_argument("--fcu-url", required=True)
    args = parser.parse_args(ours)
    try:
        vehicle = load_vehicles(args.vehicles_dir, [args.vehicle])[args.vehicle]
        program = mavros_node()
        given = arguments(args.fcu_url, vehicle.system_id)
    except (ControlError, FcsvError) as error:
        print(f"{args.vehicle}: {error}", file=sys.stderr)
        return 2
    os.execv(program, [program, *[a for a in sys.argv[1:] if ":=" in a], *given])
    return 1
