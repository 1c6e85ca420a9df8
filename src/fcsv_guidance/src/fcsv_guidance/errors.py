# SPDX-License-Identifier: Apache-2.0
"""Errors of guidance: one line that names what is wrong and what to do."""

from typing import Tuple

from fcsv_geometry.errors import FcsvError


class GuidanceError(FcsvError):
    """Base of all errors of this package."""


class GroundError(GuidanceError):
    """A map from which no ground model can be made."""


class RouteError(GuidanceError):
    """A start or goal that no route can have."""


class GoalWithoutRoomError(RouteError):
    """A goal that is free, and too near to what is not."""


class PlaceError(GuidanceError):
    """A pose that does not tell where the robot is."""


class DisputedPlaceError(PlaceError):
    """Poses that contradict each other, or have several publishers: none of them counts."""


class EndNotSeenError(RouteError):
    """Start or goal lies in ``cell`` (row, column), which was not seen."""

    def __init__(self, words: str, cell: Tuple[int, int]):
        super().__init__(words)
        self.cell = cell
