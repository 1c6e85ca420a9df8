# SPDX-License-Identifier: Apache-2.0
"""A message that came from a peer, and the packing of what is no picture."""

from dataclasses import dataclass
from typing import Optional

from fcsv_multimaster import wire
from fcsv_multimaster.links import Rule
from fcsv_multimaster.outbound import Message


@dataclass(frozen=True)
class Parcel:
    """A message that came; ``age_s`` is None before the clocks are known."""

    source: str
    topic: str
    type: str
    md5: str
    sequence: int
    packing: int
    data: bytes
    rule: Rule
    age_s: Optional[float]


def as_it_is(_target: str, message: Message, _budget_octets_s: Optional[float], _keyframe: bool):
    """The packing of what is no picture."""
    return wire.RAW, message.data
