# SPDX-License-Identifier: Apache-2.0
"""What an autopilot's parameters should be: a file that a ground station loads, with a rule and its
reason per line."""

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Dict, Iterator, Optional, Tuple

from fcsv_control.errors import ProfileError
from fcsv_control.flight.settings.parameter_files import values_of

_RULE = re.compile(r"#:\s*(must|advised|by hand (?P<name>\w+))(?P<choice> [^:]*)?: *(?P<why>.+)$")
_STREAMS = re.compile(r"^SR0_")
_TOLERANCE = 1e-6  # parameters travel as float32


@dataclass(frozen=True)
class Choice:
    """Values that fit: single ones, or a range, or all without one bit."""

    values: Tuple[float, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    without_bit: int = -1

    def fits(self, value: float) -> bool:
        """
        >>> [Choice.parsed("2 or 3").fits(v) for v in (2, 3, 4)], Choice.parsed("1..").fits(0)
        ([True, True, False], False)
        >>> [Choice.parsed("without bit 5").fits(v) for v in (0, 32, 33, 64)]
        [True, False, False, True]
        """
        if not math.isfinite(value):
            return False
        if self.without_bit >= 0:
            return not int(value) >> self.without_bit & 1
        slack = _TOLERANCE * max(1.0, abs(value))
        if self.values:
            return any(abs(value - v) <= slack for v in self.values)
        return self.low - slack <= value <= self.high + slack

    def __str__(self) -> str:
        if self.without_bit >= 0:
            return f"without bit {self.without_bit}"
        if self.values:
            return " or ".join(f"{v:g}" for v in self.values)
        ends = ["" if math.isinf(end) else f"{end:g}" for end in (self.low, self.high)]
        return "..".join(ends)

    @staticmethod
    def parsed(text: str) -> "Choice":
        """Raises ValueError."""
        text = text.strip()
        if text.startswith("without bit "):
            return Choice(without_bit=int(text[len("without bit ") :]))
        if ".." in text:
            low, high = text.split("..")
            return Choice(
                low=float(low) if low else -math.inf, high=float(high) if high else math.inf
            )
        return Choice(tuple(float(v) for v in text.split(" or ")))


@dataclass(frozen=True)
class Rule:
    """``value`` is what is written; None: it is set by hand."""

    name: str
    must: bool
    value: Optional[float]
    choice: Choice
    why: str

    def complaint(self, value: float) -> str:
        """What is wrong with a value, in one line; empty where it fits."""
        return (
            ""
            if self.choice.fits(value)
            else f"{self.name} is {value:g}, not {self.choice}: {self.why}"
        )


@dataclass(frozen=True)
class Profile:
    """Rules by parameter; without any, nothing is relied on."""

    name: str = ""
    rules: Tuple[Rule, ...] = ()

    def __iter__(self) -> Iterator[Rule]:
        return iter(self.rules)

    def rule(self, name: str) -> Optional[Rule]:
        """The rule of a parameter, or None."""
        return next((r for r in self.rules if r.name == name), None)

    @property
    def values(self) -> Dict[str, float]:
        """What is written, by name."""
        return {r.name: r.value for r in self.rules if r.value is not None}

    def at_port(self, port: int) -> "Profile":
        """Gives the profile with the stream rates of another serial port of the autopilot than USB,
        which the file has: SR0_ is SRn_."""
        here = tuple(replace(r, name=_STREAMS.sub(f"SR{port}_", r.name)) for r in self.rules)
        return replace(self, rules=here)


NOTHING = Profile()


def port_of(url: str) -> int:
    """The autopilot's port at the other end of a line, as its parameters count them: USB 0, TELEM1
    1, TELEM2 2. A serial line that is not USB is taken for TELEM2, where companions are; a network
    line's end is not known: 0.

    >>> [port_of(url) for url in ("/dev/ttyACM0:115200", "/dev/serial/by-id/usb-Holybro:1", "/dev/ttyTHS1:921600")]
    [0, 0, 2]
    >>> port_of("udpin:0.0.0.0:14550"), port_of("serial:///dev/ttyTHS1:921600")
    (0, 2)
    """
    url = url[len("serial://") :] if url.startswith("serial://") else url  # MAVROS's form
    usb = not url.startswith("/") or "ttyACM" in url or "/usb-" in url
    return 0 if usb else 2


def load_profile(path) -> Profile:
    """Raises ProfileError naming file and line."""
    try:
        return parse_profile(Path(path).read_text(encoding="utf-8"), str(path))
    except (OSError, UnicodeDecodeError) as error:
        raise ProfileError(
            f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})"
        ) from error


def parse_profile(text: str, source: str) -> Profile:
    """Raises ProfileError naming ``source`` and line."""
    rules, waiting = [], None
    for number, line in enumerate(text.splitlines(), 1):
        line, where = line.strip(), f"{source}, line {number}"
        if line.startswith("#:"):
            if waiting is not None:
                raise ProfileError(f"{where}: the rule before has no parameter")
            waiting = _rule(line, where)
            if waiting.name:
                rules, waiting = [*rules, waiting], None
        elif line and not line.startswith("#"):
            ((name, value),) = values_of(line, where).items()
            if waiting is None:
                raise ProfileError(f"{where}: {name} has no rule before it, as '#: must: why'")
            choice = waiting.choice or Choice((value,))
            if not choice.fits(value):
                raise ProfileError(
                    f"{where}: {name} {value:g} is not {choice}, as its own rule has it"
                )
            rules, waiting = [*rules, Rule(name, waiting.must, value, choice, waiting.why)], None
    if waiting is not None or not rules:
        raise ProfileError(
            f"{source}: ends with a rule without a parameter"
            if waiting
            else f"{source}: has no rules"
        )
    names = [r.name for r in rules]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise ProfileError(f"{source}: {', '.join(twice)} stands there twice")
    return Profile(Path(source).name, tuple(rules))


def _rule(line: str, where: str) -> Rule:
    """A rule; without its parameter's name where that is on the next line."""
    match = _RULE.match(line)
    try:
        choice = Choice.parsed(match["choice"]) if match and match["choice"] else None
    except ValueError:
        match = None
    if match is None or (match["name"] and choice is None):
        raise ProfileError(
            f"{where}: '{line}' is no rule, as '#: must 2 or 3: why' or '#: by hand NAME 1..: why'"
        )
    return Rule(match["name"] or "", match[1] == "must", None, choice, match["why"])
