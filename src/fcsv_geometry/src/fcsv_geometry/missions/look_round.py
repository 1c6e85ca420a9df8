# SPDX-License-Identifier: Apache-2.0
"""Looking round (field of a mission file): vehicles that stand turn once about themselves."""

from dataclasses import dataclass

# slower takes minutes; faster smears depth, and more than the pictures' own witness follows
_RATES_DPS = (3.0, 30.0)
_RAMP_S = 1.0  # from standing to the full rate


@dataclass(frozen=True)
class LookRound:
    """Cameras look one way: what is beside and behind a vehicle its depth camera sees only where it
    turns.

    ``column``: every vehicle turns where it stands, once the reference is home and before the list
    is flown; ``places``: so does the mover of each configuration at its place (of a sweep where it
    begins), before it is recorded. One vehicle turns at a time, and nobody flies meanwhile.
    """

    column: bool = True  # every vehicle turns in the column, once home is set
    places: bool = True  # the mover turns at each place before it is recorded
    rate_dps: float = 20.0  # of a turn

    def __post_init__(self):
        low, high = _RATES_DPS
        if not low <= self.rate_dps <= high:
            raise ValueError(
                f"rate_dps: {self.rate_dps} is not in {low:g}..{high:g} degrees a second"
            )
        if not (self.column or self.places):
            raise ValueError(
                "column: and places are both false, so nobody would turn; leave look_round out"
            )

    @property
    def ramp_dps2(self) -> float:
        """How fast (degrees/s^2) the rate itself rises and falls."""
        return self.rate_dps / _RAMP_S

    @property
    def turn_s(self) -> float:
        """Time (s) of one whole turn from standing to standing.

        >>> LookRound(rate_dps=20.0).turn_s
        19.0
        """
        return 360.0 / self.rate_dps + _RAMP_S
