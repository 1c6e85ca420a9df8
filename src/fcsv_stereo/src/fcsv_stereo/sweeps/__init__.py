# SPDX-License-Identifier: Apache-2.0
"""Recordings in which a camera moves all the time: which of its pictures a map takes, and what time
they are of."""

from fcsv_stereo.sweeps.choice import MOVES_M, moves, spread
from fcsv_stereo.sweeps.clock import StampOffset, clock_offset
from fcsv_stereo.sweeps.timing import on_time

__all__ = ["MOVES_M", "StampOffset", "clock_offset", "moves", "on_time", "spread"]
