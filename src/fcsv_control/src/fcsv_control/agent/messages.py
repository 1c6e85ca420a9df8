# SPDX-License-Identifier: Apache-2.0
"""What the agent is told and what it wants done."""

from enum import Enum
from typing import Optional, Union

import numpy as np

from fcsv_geometry.frozen import frozen
from fcsv_geometry.vehicles.modes import Mode

DONE, REFUSED, TOO_LATE, BY_HAND = 0, 1, 2, 3  # CommandAck.result


class Kind(Enum):
    """What a command asks for; values as in fcsv_msgs/Command."""

    SET_MODE = 1
    GOTO = 2
    HOLD = 3
    RECORD = 4
    LAND = 5
    ARM = 6
    TAKEOFF = 7


@frozen
class Instruction:
    """A numbered command. Which of the last fields count depends on the kind.

    ``sent_s`` (when this copy was sent) and ``ordered_s`` are by a monotonic clock of the sender,
    whose zero is anywhere. It is not begun later than ``lifetime_s`` after it was ordered, unless
    it stops the vehicle.
    """

    vehicle: str
    sender: str
    number: int
    kind: Kind
    sent_s: float
    ordered_s: float
    lifetime_s: float
    mode: Mode = Mode.UNHEARD
    flag: bool = False
    altitude_m: float = 0.0
    target: Optional[np.ndarray] = None  # T_odom_body
    frame: str = ""

    @property
    def stops(self) -> bool:
        """Whether it stops the vehicle: it never waits and never comes too late by the clock."""
        return self.kind in (Kind.HOLD, Kind.LAND) or (
            self.kind is Kind.SET_MODE and self.mode.stops
        )

    @property
    def moves(self) -> bool:
        """Whether it makes the vehicle fly, or able to fly: only who commands the vehicle may ask
        for it."""
        return self.kind is not Kind.RECORD and not self.stops

    @property
    def to_guided(self) -> bool:
        """Whether it hands the vehicle to the companion computer."""
        return self.kind is Kind.SET_MODE and self.mode == Mode.GUIDED


@frozen
class Ask:
    """A request to the flight link, by a service. The core is told of its end, the port of each
    answer."""

    kind: Kind  # SET_MODE, ARM or TAKEOFF
    mode: Mode = Mode.UNHEARD
    flag: bool = False
    altitude_m: float = 0.0
    number: int = 0


@frozen
class AskAnswered:
    """The flight link's service answered an Ask: whether it ``took`` it. ``error``: why it did not
    answer at all."""

    number: int
    took: bool
    error: str = ""


@frozen
class Ack:
    """The answer to a command."""

    sender: str
    number: int
    result: int
    reason: str


@frozen
class SetPoint:
    """Where to hold: T_odom_body."""

    T_odom_body: np.ndarray


@frozen
class Pictures:
    """Whether the recorder writes pictures."""

    on: bool


@frozen
class AgentText:
    """Something that the log and the operator should know."""

    text: str


@frozen
class AgentAlive:
    """A sign of life of an agent of this vehicle, by its own monotonic clock. ``commander``: who
    may move the vehicle now; ``problem``: why it does nothing, empty where it does."""

    instance: str
    started_s: float
    sent_s: float
    commander: str = ""
    problem: str = ""


Output = Union[Ask, Ack, SetPoint, Pictures, AgentText]
