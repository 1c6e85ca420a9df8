# SPDX-License-Identifier: Apache-2.0
"""Poses that come to a flight link as messages."""

from typing import Optional

import numpy as np
from geometry_msgs.msg import PoseStamped

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health


def pose_in(frame: str, message: PoseStamped, what: str, health: Health) -> Optional[np.ndarray]:
    """T_frame_body (4, 4), or None where it is dropped, which ``health`` tells: in another frame,
    or no pose."""
    if message.header.frame_id != frame:
        health.drop(f"{what} in a wrong frame", f"'{message.header.frame_id}' is not '{frame}'")
        return None
    try:
        return conversions.pose_to_transform(message.pose)
    except FcsvError as error:
        health.drop(f"{what} that is no pose", str(error))
        return None
