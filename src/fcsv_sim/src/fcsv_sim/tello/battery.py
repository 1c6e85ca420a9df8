# SPDX-License-Identifier: Apache-2.0
"""The Tello's battery: one cell of 1100 mAh that a hover empties in 13 minutes (its maker's
figures)."""

from dataclasses import dataclass

_HOVER_S = 780.0
_IDLE_S = 5400.0  # switched on, motors off
_EMPTY_V, _FULL_V, _SAG_V = 3.3, 4.2, 0.25


@dataclass(frozen=True)
class BatteryRules:
    """When it warns and acts. Who flies it sets the warning's threshold; the real one's other is
    not known."""

    percent: float = 95.0  # at the start
    low_percent: float = 10.0  # warns, refuses take-off
    critical_percent: float = 5.0  # lands by itself
    hover_s: float = _HOVER_S  # full to empty in a hover

    def __post_init__(self):
        if not 0.0 <= self.percent <= 100.0:
            raise ValueError(f"percent: {self.percent} must be 0 to 100")
        if self.hover_s <= 0.0:
            raise ValueError(f"hover_s: {self.hover_s} must be positive")


class TelloBattery:
    """drain() as time passes."""

    def __init__(self, rules: BatteryRules):
        self._rules = rules
        self.low_percent = rules.low_percent
        self._percent = rules.percent
        self._load = 0.0

    def change(self, percent: float) -> None:
        """Exchanges the battery for another one. Raises ValueError where there is none such."""
        if not 0.0 <= percent <= 100.0:
            raise ValueError(f"percent: {percent} must be 0 to 100")
        self._percent = percent

    @property
    def percent(self) -> int:
        """Whole percents, as it says them."""
        return int(self._percent)

    @property
    def volts(self) -> float:
        """Gives the voltage of the cell: falls with its charge and under load."""
        return (
            _EMPTY_V + (_FULL_V - _EMPTY_V) * self._percent / 100.0 - _SAG_V * min(self._load, 2.0)
        )

    @property
    def left_s(self) -> float:
        """Flight time that is left in a hover."""
        return self._percent / 100.0 * self._rules.hover_s

    @property
    def low(self) -> bool:
        return self._percent <= self.low_percent

    @property
    def critical(self) -> bool:
        return self._percent <= self._rules.critical_percent

    @property
    def empty(self) -> bool:
        return self._percent <= 0.0

    def drain(self, dt_s: float, thrust_over_hover: float) -> None:
        """``dt_s`` of flight; power goes with thrust to the power 1.5 (momentum theory)."""
        self._load = max(0.0, thrust_over_hover) ** 1.5
        spent = dt_s * (self._load / self._rules.hover_s + 1.0 / _IDLE_S)
        self._percent = max(0.0, self._percent - 100.0 * spent)
