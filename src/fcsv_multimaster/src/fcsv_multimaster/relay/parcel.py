# SPDX-License-Identifier: Apache-2.0
"""A message that came from a peer, and the packing of what is no picture."""

from dataclasses import dataclass
from typing import Optional

from fcsv_multimaster.links import LinkRule
from fcsv_multimaster.network import wire
from fcsv_multimaster.relay.outbound import Message


@dataclass(frozen=True)
class Parcel:
    """A message that came at ``came_s`` (monotonic); ``age_s`` is None before the clocks are known,
    and may be wrong by ``unsure_s``."""

    source: str
    topic: str
    type: str
    md5: str
    sequence: int
    packing: int
    data: bytes
    rule: LinkRule
    age_s: Optional[float]
    came_s: float
    unsure_s: float = 0.0

    def late(self, now_s: float) -> bool:
        """Whether it is older by now than its class allows."""
        most_s = self.rule.traffic.max_age_s
        return (
            most_s is not None
            and self.age_s is not None
            and self.age_s + now_s - self.came_s > most_s
        )


def as_it_is(_target: str, message: Message, _budget_octets_s: Optional[float], _keyframe: bool):
    """The packing of what is no picture."""
    return wire.RAW, message.data
