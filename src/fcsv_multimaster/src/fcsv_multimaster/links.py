# SPDX-License-Identifier: Apache-2.0
"""The links file: classes of traffic, and which topics cross in which direction."""

from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional

from fcsv_geometry import config

CONTROL = "control"
LINKS = ("urgent", "bulk")
PRIORITIES = ("real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background")


@dataclass(frozen=True)
class TrafficClass:
    """How messages of a class travel; ``max_age_s``: older ones are dropped on arrival."""

    link: str
    priority: str
    reliable: bool
    latched: bool = False
    max_age_s: Optional[float] = None
    rate_hz: Optional[float] = None

    def __post_init__(self):
        if self.link not in LINKS:
            raise ValueError(f"link: '{self.link}' is not one of {', '.join(LINKS)}")
        if self.priority not in PRIORITIES:
            raise ValueError(f"priority: '{self.priority}' is not one of {', '.join(PRIORITIES)}")
        for name in ("max_age_s", "rate_hz"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name}: {value} must be positive")


@dataclass(frozen=True)
class Rule:
    """One topic that crosses."""

    topic: str
    traffic: TrafficClass
    rate_hz: Optional[float] = None

    @property
    def most_hz(self) -> Optional[float]:
        return self.rate_hz or self.traffic.rate_hz


@dataclass(frozen=True)
class _RuleEntry:
    topic: str
    traffic: str
    rate_hz: Optional[float] = None


@dataclass(frozen=True)
class Links:
    """The whole file."""

    classes: Dict[str, TrafficClass]
    to_control: List[Rule] = field(default_factory=list)
    to_vehicle: List[Rule] = field(default_factory=list)
    to_all_vehicles: List[Rule] = field(default_factory=list)
    between_vehicles: List[Rule] = field(default_factory=list)

    def crossing(self, source: str, target: str) -> Dict[str, Rule]:
        """Topic name to rule, of what ``source`` sends to ``target``."""
        if source == target:
            return {}
        if target == CONTROL:
            rules, name = self.to_control, source
        elif source == CONTROL:
            rules, name = [*self.to_vehicle, *self.to_all_vehicles], target
        else:
            rules, name = self.between_vehicles, source
        return {r.topic.replace("{vehicle}", name): r for r in rules}


_SECTIONS = ("to_control", "to_vehicle", "to_all_vehicles", "between_vehicles")


def load_links(path) -> Links:
    """Raises ConfigError naming file and field."""
    document = config.read_yaml(path)
    if not isinstance(document, dict):
        raise config.ConfigError(f"{path}: must hold classes and the sections {', '.join(_SECTIONS)}")
    unknown = set(document) - {"classes", *_SECTIONS}
    if unknown:
        raise config.ConfigError(f"{path}: unknown key '{sorted(unknown)[0]}'; known: classes, {', '.join(_SECTIONS)}")
    classes = {
        name: config.from_mapping(entry, TrafficClass, str(path), f"classes.{name}")
        for name, entry in (document.get("classes") or {}).items()
    }
    sections = {s: _rules(document.get(s) or [], s, classes, path) for s in _SECTIONS}
    return Links(classes, **sections)


def _rules(entries: Any, section: str, classes: Dict[str, TrafficClass], path) -> List[Rule]:
    if not isinstance(entries, list):
        raise config.ConfigError(f"{path}: '{section}' must be a list of {{topic, class}}")
    rules = []
    for i, entry in enumerate(entries):
        at = f"{section}[{i}]"
        if isinstance(entry, dict) and "class" in entry:
            entry = {("traffic" if k == "class" else k): v for k, v in entry.items()}
        parsed = config.from_mapping(entry, _RuleEntry, str(path), at)
        if parsed.traffic not in classes:
            raise config.ConfigError(f"{path}: '{at}.class' is '{parsed.traffic}'; known: {', '.join(classes)}")
        if not parsed.topic.startswith("/"):
            raise config.ConfigError(f"{path}: '{at}.topic' is '{parsed.topic}'; topics here begin with /")
        rules.append(Rule(parsed.topic, classes[parsed.traffic], parsed.rate_hz))
    return rules
