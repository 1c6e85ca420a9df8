# SPDX-License-Identifier: Apache-2.0
"""The links file: classes of traffic, and which topics cross in which direction."""

from dataclasses import dataclass, field, fields, replace
from typing import Any, Dict, List, Optional, Tuple

from fcsv_geometry import config

CONTROL = "control"
LINKS = ("datagram", "urgent", "bulk")
TF_TOPICS = ("/tf", "/tf_static")
CODECS = ("jpeg", "h264")
PRIORITIES = (
    "real_time",
    "interactive_high",
    "interactive_low",
    "data_high",
    "data",
    "data_low",
    "background",
)


@dataclass(frozen=True)
class TrafficClass:
    """How messages of a class travel.

    ``link``: datagram (small and urgent), urgent (any size), bulk (pictures). ``reliable``:
    repeated until the other relay has acknowledged it, else newest wins. ``latched``: the last
    value goes to whoever comes later. ``max_age_s``: older ones are not sent, not repeated, and
    dropped on arrival. ``max_bytes``: larger ones are, too.
    """

    link: str  # datagram: small and urgent; urgent: a stream, any size; bulk: pictures, paced
    priority: str  # of Zenoh
    reliable: bool  # repeated until acknowledged; else newest wins
    latched: bool = False  # the last value goes to whoever comes later
    max_age_s: Optional[float] = None  # older ones are dropped
    rate_hz: Optional[float] = None  # at most; none: all
    max_bytes: int = 4_000_000  # larger ones are dropped

    @property
    def queue_size(self) -> int:
        """Gives the length of ROS's queues on either side: where every message counts, a burst
        after a cut must fit."""
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
class LinkRule:
    """One topic that crosses.

    ``codec``: how pictures (sensor_msgs/Image, CompressedImage) are packed on the way, by what the
    link carries. ``frames``: of a tf topic the child frames that cross; the others stay at home.
    """

    topic: str
    traffic: TrafficClass
    rate_hz: Optional[float] = None
    codec: Optional[str] = None
    frames: Tuple[str, ...] = ()

    def of(self, vehicle: str) -> "LinkRule":
        """The rule for one vehicle, its name in place of {vehicle}."""
        frames = tuple(f.replace("{vehicle}", vehicle) for f in self.frames)
        return replace(self, topic=self.topic.replace("{vehicle}", vehicle), frames=frames)

    @property
    def most_hz(self) -> Optional[float]:
        return self.rate_hz or self.traffic.rate_hz


@dataclass(frozen=True)
class RuleEntry:
    """A rule as the file has it, where ``traffic`` is called ``class``."""

    topic: str  # begins with /; {vehicle} stands for each vehicle's name
    traffic: str  # one of the file's classes
    rate_hz: Optional[float] = None  # in place of the class's
    codec: Optional[str] = None  # how pictures are packed: jpeg or h264; a class of the bulk link
    # of /tf and /tf_static: the child frames that cross
    frames: List[str] = field(default_factory=list)

    def __post_init__(self):
        if self.codec is not None and self.codec not in CODECS:
            raise ValueError(f"codec: '{self.codec}' is not one of {', '.join(CODECS)}")
        if self.rate_hz is not None and not self.rate_hz > 0:
            raise ValueError(f"rate_hz: {self.rate_hz} must be positive")
        if (self.topic in TF_TOPICS) != bool(self.frames):
            raise ValueError(
                f"frames: belongs to {' and '.join(TF_TOPICS)}, and names the child frames that cross"
            )


@dataclass(frozen=True)
class Links:
    """The whole file."""

    classes: Dict[str, TrafficClass]
    to_control: List[LinkRule] = field(default_factory=list)
    to_vehicle: List[LinkRule] = field(default_factory=list)
    to_all_vehicles: List[LinkRule] = field(default_factory=list)
    between_vehicles: List[LinkRule] = field(default_factory=list)

    def crossing(self, source: str, target: str) -> Dict[str, LinkRule]:
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


SECTIONS = ("to_control", "to_vehicle", "to_all_vehicles", "between_vehicles")


def load_links(path) -> Links:
    """The links in a YAML file. Raises ConfigError naming file and field."""
    return parse_links(config.read_yaml(path), str(path))


def parse_links(document: Any, path: str) -> Links:
    """The links in a document, whose file ``path`` names in errors. Raises ConfigError."""
    if not isinstance(document, dict):
        raise config.ConfigError(
            f"{path}: must hold classes and the sections {', '.join(SECTIONS)}"
        )
    for key in document:
        if key not in ("classes", *SECTIONS):
            raise config.unknown_key(str(path), "", key, ("classes", *SECTIONS))
    given = document.get("classes") or {}
    if not isinstance(given, dict):
        raise config.ConfigError(
            f"{path}: 'classes' must be a mapping of NAME: {{link, priority, ...}}", "classes"
        )
    classes = {
        name: config.from_mapping(entry, TrafficClass, str(path), f"classes.{name}")
        for name, entry in given.items()
    }
    sections = {s: _rules(document.get(s) or [], s, classes, path) for s in SECTIONS}
    return Links(classes, **sections)


def _rules(entries: Any, section: str, classes: Dict[str, TrafficClass], path) -> List[LinkRule]:
    if not isinstance(entries, list):
        raise config.ConfigError(f"{path}: '{section}' must be a list of {{topic, class}}")
    rules = []
    for i, entry in enumerate(entries):
        at = f"{section}[{i}]"
        parsed = config.from_mapping(_with_traffic(entry, at, path), RuleEntry, str(path), at)
        if parsed.traffic not in classes:
            near = config.nearest(parsed.traffic, classes)
            hint = f"; did you mean '{near}'?" if near else ""
            raise config.ConfigError(
                f"{path}: '{at}.class' is '{parsed.traffic}'; known: {', '.join(classes)}{hint}"
            )
        if not parsed.topic.startswith("/"):
            raise config.ConfigError(
                f"{path}: '{at}.topic' is '{parsed.topic}'; topics here begin with /"
            )
        traffic = classes[parsed.traffic]
        if parsed.codec is not None and traffic.link != "bulk":
            raise config.ConfigError(
                f"{path}: '{at}.codec' needs a class on the bulk link, not '{parsed.traffic}'"
            )
        if parsed.topic == "/tf_static" and not traffic.latched:
            raise config.ConfigError(
                f"{path}: '{at}.class' of /tf_static must be latched, '{parsed.traffic}' is not"
            )
        rules.append(
            LinkRule(parsed.topic, traffic, parsed.rate_hz, parsed.codec, tuple(parsed.frames))
        )
    return rules


def _with_traffic(entry: Any, at: str, path) -> Any:
    """The entry with its ``class`` as RuleEntry names it."""
    if not isinstance(entry, dict):
        return entry
    known = ["class" if f.name == "traffic" else f.name for f in fields(RuleEntry)]
    for key in entry:
        if key not in known:
            raise config.unknown_key(str(path), at, key, known)
    if "class" not in entry:
        raise config.ConfigError(f"{path}: '{at}.class' is missing", f"{at}.class", "is missing")
    return {("traffic" if key == "class" else key): value for key, value in entry.items()}
