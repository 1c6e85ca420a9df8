# SPDX-License-Identifier: Apache-2.0
"""The links file: classes of traffic, and which topics cross in which direction."""

from dataclasses import dataclass, field, replace
from typing import Any, Dict, List, Optional, Tuple

from fcsv_geometry import config

CONTROL = "control"
LINKS = ("datagram", "urgent", "bulk")
TF_TOPICS = ("/tf", "/tf_static")
CODECS = ("jpeg", "h264")
PRIORITIES = ("real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background")


@dataclass(frozen=True)
class TrafficClass:
    """How messages of a class travel.

    ``link``: datagram (small and urgent), urgent (any size), bulk (pictures). ``reliable``: repeated until
    the other relay has acknowledged it, else newest wins. ``latched``: the last value goes to whoever comes later.
    ``max_age_s``: older ones are not sent, not repeated, and dropped on arrival. ``max_bytes``: larger ones are, too.
    """

    link: str
    priority: str
    reliable: bool
    latched: bool = False
    max_age_s: Optional[float] = None
    rate_hz: Optional[float] = None
    max_bytes: int = 4_000_000

    @property
    def queue_size(self) -> int:
        """Gives the length of ROS's queues on either side: where every message counts, a burst after a cut must fit."""
        if not self.reliable:
            return 20
        return 64 if self.link == "bulk" else 500

    def __post_init__(self):
        if self.link not in LINKS:
            raise ValueError(f"link: '{self.link}' is not one of {', '.join(LINKS)}")
        if self.priority not in PRIORITIES:
            raise ValueError(f"priority: '{self.priority}' is not one of {', '.join(PRIORITIES)}")
        if self.latched and (not self.reliable or self.link == "bulk"):
            raise ValueError("latched: needs reliable: true and a link other than bulk")
        for name in ("max_age_s", "rate_hz", "max_bytes"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name}: {value} must be positive")


@dataclass(frozen=True)
class Rule:
    """One topic that crosses.

    ``codec``: how pictures (sensor_msgs/Image, CompressedImage) are packed on the way, by what the link carries.
    ``frames``: of a tf topic the child frames that cross; the others stay at home.
    """

    topic: str
    traffic: TrafficClass
    rate_hz: Optional[float] = None
    codec: Optional[str] = None
    frames: Tuple[str, ...] = ()

    def of(self, vehicle: str) -> "Rule":
        """The rule for one vehicle, its name in place of {vehicle}."""
        frames = tuple(f.replace("{vehicle}", vehicle) for f in self.frames)
        return replace(self, topic=self.topic.replace("{vehicle}", vehicle), frames=frames)

    @property
    def most_hz(self) -> Optional[float]:
        return self.rate_hz or self.traffic.rate_hz


@dataclass(frozen=True)
class _RuleEntry:
    topic: str
    traffic: str
    rate_hz: Optional[float] = None
    codec: Optional[str] = None
    frames: List[str] = field(default_factory=list)

    def __post_init__(self):
        if self.codec is not None and self.codec not in CODECS:
            raise ValueError(f"codec: '{self.codec}' is not one of {', '.join(CODECS)}")
        if self.rate_hz is not None and not self.rate_hz > 0:
            raise ValueError(f"rate_hz: {self.rate_hz} must be positive")
        if (self.topic in TF_TOPICS) != bool(self.frames):
            raise ValueError(f"frames: belongs to {' and '.join(TF_TOPICS)}, and names the child frames that cross")


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
        return {r.topic: r for r in (rule.of(name) for rule in rules)}


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
        traffic = classes[parsed.traffic]
        if parsed.codec is not None and traffic.link != "bulk":
            raise config.ConfigError(f"{path}: '{at}.codec' needs a class on the bulk link, not '{parsed.traffic}'")
        if parsed.topic == "/tf_static" and not traffic.latched:
            raise config.ConfigError(f"{path}: '{at}.class' of /tf_static must be latched, '{parsed.traffic}' is not")
        rules.append(Rule(parsed.topic, traffic, parsed.rate_hz, parsed.codec, tuple(parsed.frames)))
    return rules
