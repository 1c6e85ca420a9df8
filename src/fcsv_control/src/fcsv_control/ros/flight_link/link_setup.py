# SPDX-License-Identifier: Apache-2.0
"""What a flight link's port is made of, out of a node's parameters: by itself and beside MAVROS."""

from dataclasses import replace
from typing import Any, Tuple

from fcsv_control.flight.port import ExternalNavigationRules
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_control.flight.settings.profile import Profile, load_profile, port_of
from fcsv_geometry.ros import node


def link_setup(p: Any) -> Tuple[LinkParameters, Profile, ExternalNavigationRules]:
    """Gives link, profile and rules of ``p``: FlightLinkNodeParameters or MavrosCompanionParameters.

    The system id is that of the vehicle's file where the link names none, and the profile's stream
    rates are those of the autopilot's port. Raises FcsvError where a file is wrong.
    """
    link = p.link
    if p.vehicles_dir and not link.target_system:
        system_id = node.vehicles(p.vehicles_dir, [p.vehicle])[p.vehicle].system_id
        link = replace(link, target_system=system_id)
    port = p.autopilot_port if p.autopilot_port >= 0 else port_of(p.fcu_url)
    profile = load_profile(p.autopilot_profile).at_port(port)
    return link, profile, ExternalNavigationRules(p.feed, p.watchdog, p.feed_check)
