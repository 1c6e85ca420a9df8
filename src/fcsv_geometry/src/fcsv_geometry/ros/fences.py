# SPDX-License-Identifier: Apache-2.0
"""Fences as /mission/fence (fcsv_msgs/Fence)."""

from geometry_msgs.msg import Point32, Polygon

from fcsv_geometry.errors import GeometryError
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import Fence as FenceMessage


def to_message(fence: Fence, stamp_s: float) -> FenceMessage:
    """The message; ``stamp_s`` in the time of day."""
    corners = Polygon([Point32(x, y, 0.0) for x, y in fence.polygon])
    return FenceMessage(
        conversions.header(stamp_s, ""), fence.floor_m, fence.ceiling_m, fence.radius_m, corners
    )


def from_message(message: FenceMessage) -> Fence:
    """Raises GeometryError where it is no fence: NaN, a ceiling under the floor, a polygon of two
    corners."""
    polygon = [(float(p.x), float(p.y)) for p in message.polygon.points]
    try:
        return Fence(message.floor_m, message.ceiling_m, message.radius_m, polygon)
    except ValueError as error:
        raise GeometryError(f"no fence: {error}") from error
