# SPDX-License-Identifier: Apache-2.0
"""docs/reference/files.md: every key of the configuration files, out of the classes that read them.

Names, defaults and meanings (the comment beside a field) are the classes' own. Ranges are tried
out: a value is put into a good file, and the file's parser says whether it takes it.
"""

import copy
import dataclasses
import inspect
import math
import re
import typing
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Optional, Sequence, Tuple

from field_notes import notes_of

from fcsv_control.file_check.kinds import KINDS, YAML_KINDS, FileKind, imported
from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError, FcsvError
from fcsv_multimaster.links import SECTIONS, RuleEntry, TrafficClass, parse_links

ROOT = Path(__file__).resolve().parents[2]
_POI = {"points_of_interest": [{"name": "roof", "u_px": 320.0, "v_px": 240.0}]}
#: By kind good files, beside an empty one: into the first that has the place a value is put.
_PLACE = {"latitude_deg": 48.0, "longitude_deg": 11.0}
_ON_EARTH = {
    "name": "site",
    "configurations": [{"axis": "vertical", "baseline_m": 4.0}],
    "home_fix": {**_PLACE, "course_deg": 0.0},
    "stations": [{**_PLACE, "headings_deg": [0.0]}],
}
_FOLLOWED = {
    "name": "follow",
    "configurations": [{"axis": "vertical", "baseline_m": 4.0, "follow_s": 60.0}],
}
_EXAMPLES: Dict[str, Sequence[Any]] = {
    "mission": ("missions/short", "missions/sweep", "missions/near", _ON_EARTH, _FOLLOWED),
    "vehicle": ("vehicles/uav1",),
    "robot": ("robots/small", "robots/rescue"),
    "gimbals": ("gimbal/ground_robot",),
    "tilting rig": ("tilting/rig",),
    "points of interest": (_POI,),
    "links": ("links/default",),
}
_UNITS = (
    ("_m_per_sqrt_m", "m/√m"),
    ("_deg_per_sqrt_m", "degrees/√m"),
    ("_m_per_sqrt_s", "m/√s"),
    ("_per_s", "1/s"),
    ("_mps2", "m/s²"),
    ("_mps", "m/s"),
    ("_radps", "rad/s"),
    ("_dps", "degrees/s"),
    ("_deg", "degrees"),
    ("_mib", "MiB"),
    ("_hz", "Hz"),
    ("_px", "px"),
    ("_share", "share of 1"),
    ("_bytes", "bytes"),
    ("_m", "m"),
    ("_s", "s"),
)
_FAR, _HALVINGS = 1e9, 80
# values that are named one by one; decimals of an end that is no rounding of another
_FEW, _DIGITS = 4, 4
_TRIED = [1, 2, 4, 10, 100, 300, 0.3, 0.1, 0.03, 0.01]  # until one is taken, where no default is
_HEAD = (
    "Every key of the files in `config/`, as their parsers have them. `rosrun fcsv_control check FILE...`, or without "
    "ROS `fcsv check FILE...`, says whether a file is good. An unknown key is refused. A range is that of one key in a "
    "good file, the others as in it; text in a range is what the parser asks for. `[]` stands for each entry of a list."
)
Row = Tuple[str, str, str, str, str]
Takes = Callable[[str, Any], str]


def page(head: str) -> str:
    """The whole page; ``head``: its first line."""
    lines = [head, "# Configuration files", "", _HEAD, ""]
    for kind in YAML_KINDS:
        if kind.name == "links":
            lines += _section(
                kind, "`RuleEntry` and `TrafficClass` of `fcsv_multimaster/links.py`", _links_rows()
            )
        elif kind.schema:
            cls = imported(kind.schema)
            module, name = kind.schema.split(":")
            where = f"`{name}` of `{module.replace('.', '/')}.py`"
            lines += _section(kind, where, list(_rows(cls, "", None, _tried(kind, cls))))
    return "\n".join([*lines, *_others()]).rstrip() + "\n"


def _section(kind: FileKind, where: str, rows: Sequence[Row]) -> List[str]:
    title = f"{kind.name[0].upper()}{kind.name[1:]}"
    place = (
        f"`config/{kind.folder}/`" if (ROOT / "config" / kind.folder).is_dir() else "Of your own"
    )
    table = [
        f"| `{key}` | {unit} | {default} | {span} | {_cell(words)} |"
        for key, unit, default, span, words in rows
    ]
    return [
        f"## {title}",
        "",
        f"{place}; {where}.",
        "",
        "| key | unit | default | range | meaning |",
        "|---|---|---|---|---|",
        *table,
        "",
    ]


def _others() -> List[str]:
    lines = ["## Files without keys of ours", "", "| kind | where | what it is |", "|---|---|---|"]
    for kind in KINDS.values():
        if not kind.schema and kind.name != "links":
            reader = f"`{kind.reader.partition(':')[2]}` of `{kind.reader.partition(':')[0].replace('.', '/')}.py`"
            what = (
                f"keys of {kind.foreign}; checked as YAML" if kind.foreign else f"read by {reader}"
            )
            keys = (
                f": {', '.join(f'`{k}`' for k in kind.keys)}"
                if kind.keys and not kind.foreign
                else ""
            )
            place = (
                f"`config/{kind.folder}/`"
                if (ROOT / "config" / kind.folder).is_dir()
                else "`config/`"
            )
            place = (
                place if kind.foreign or kind.folder == "autopilot" else "where your driver has it"
            )
            lines.append(f"| {kind.name} | {place} | {what}{keys} |")
    return lines


# ---- rows ----------------------------------------------------------------------------------------


def _rows(
    cls, at: str, standard: Optional[Any], takes: Takes, above: Tuple[type, ...] = ()
) -> Iterator[Row]:
    """Of a class's fields, nested ones below theirs; ``standard``: an instance with the defaults
    that count here; ``above``: classes whose keys stand above already."""
    listed: List[type] = [*above]
    hints, notes = typing.get_type_hints(cls), notes_of(cls)
    for field in (f for f in dataclasses.fields(cls) if f.init):
        path, kind = f"{at}{field.name}", hints[field.name]
        default = _default(field) if standard is None else getattr(standard, field.name)
        inner, many = _inner(kind)
        meaning = notes.get(field.name, "") or (_sentence(inner) if inner else "")
        if not meaning:
            raise SystemExit(
                f"{cls.__module__}.{cls.__name__}.{field.name}: no comment says what it means"
            )
        if inner is None:
            yield (
                path,
                _unit(field.name),
                _shown(default),
                _range(path, kind, default, takes),
                meaning,
            )
            continue
        span = "list" if many else ""
        yield path, "", "" if dataclasses.is_dataclass(default) else _shown(default), span, meaning
        if many and inner in listed:
            continue
        listed.append(inner)
        base = default if dataclasses.is_dataclass(default) else None
        yield from _rows(inner, f"{path}[]." if many else f"{path}.", base, takes, tuple(listed))


def _inner(kind: Any) -> Tuple[Optional[type], bool]:
    """(the class that an entry is made of, whether there is a list of them)."""
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Union:
        return _inner(args[0])
    if origin in (list, tuple) and dataclasses.is_dataclass(args[0]):
        return args[0], True
    return (kind, False) if dataclasses.is_dataclass(kind) else (None, False)


def _sentence(cls) -> str:
    return (
        " ".join((inspect.getdoc(cls) or "").split("\n\n")[0].split())
        .partition(". ")[0]
        .rstrip(".")
    )


def _default(field: dataclasses.Field) -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default


def _shown(default: Any) -> str:
    if default is dataclasses.MISSING:
        return "must be given"
    if default is None or default == "" or (isinstance(default, float) and math.isnan(default)):
        return "none"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, (list, tuple)):
        return f"`[{', '.join(f'{v:g}' for v in default)}]`"
    return f"`{default:g}`" if isinstance(default, float) else f"`{default}`"


def _unit(name: str) -> str:
    return next((unit for end, unit in _UNITS if name.endswith(end)), "")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("``", "`").replace("|", "\\|").replace("<", "&lt;")


# ---- ranges --------------------------------------------------------------------------------------


def _tried(kind: FileKind, cls) -> Takes:
    """Of a kind: what its parser says to a value at a path, "" where it takes it."""
    documents = [_document(e) for e in _EXAMPLES.get(kind.name, ())] + [{}]

    def takes(path: str, value: Any) -> str:
        puts = (_put(d, path, value, makes) for makes in range(3) for d in documents)
        document = next(put for put in puts if put is not None)
        return _complaint(lambda: config.from_mapping(document, cls, "file"))

    return takes


def _complaint(parse: Callable[[], Any]) -> str:
    try:
        parse()
    except ConfigError as error:
        return error.problem or str(error)
    except FcsvError as error:
        return str(error)
    return ""


def _document(example: Any) -> Any:
    return (
        config.read_yaml(ROOT / "config" / f"{example}.yaml")
        if isinstance(example, str)
        else example
    )


def _put(document: Any, path: str, value: Any, makes: int) -> Optional[Any]:
    """A copy of the document with a value at a path; None where a part is missing, unless it
    ``makes`` them: 1: the last part, 2: all."""
    changed = copy.deepcopy(document)
    *above, last = path.split(".")
    here = changed
    for part in above:
        name = part.replace("[]", "")
        if name not in here:
            if part.endswith("[]") or makes < 2:
                return None
            here[name] = {}
        here = here[name][0] if part.endswith("[]") else here[name]
    if last not in here and not makes:
        return None
    here[last] = value
    return changed


def _range(path: str, kind: Any, default: Any, takes: Takes) -> str:
    """In words."""
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Union:
        return _range(path, args[0], default, takes)
    if kind is bool:
        return "true, false"
    if kind is str:
        return _words(takes(path, "?!"))
    if origin in (list, tuple):
        return _items(origin, args)
    given = (
        isinstance(default, (int, float))
        and not isinstance(default, bool)
        and math.isfinite(default)
    )
    good = next(
        (v for v in ([default] if given else []) + _TRIED if not takes(path, kind(v))), None
    )
    if good is None:
        raise SystemExit(f"{path}: no number is taken ({takes(path, kind(1))})")
    low, high = (_end(path, kind, kind(good), kind(far), takes) for far in (-_FAR, _FAR))
    if kind is int and low and high and high[0] - low[0] <= _FEW:
        return ", ".join(str(v) for v in range(int(low[0]), int(high[0]) + 1) if not takes(path, v))
    return _span(low, high)


def _items(origin, args) -> str:
    if origin is tuple and args[-1] is not Ellipsis:
        return f"{len(args)} numbers"
    inner = typing.get_args(args[0])
    return f"list of [{', '.join('xyz'[: len(inner)])}]" if inner else "list"


def _words(complaint: str) -> str:
    """What a parser asks for where it refused a word."""
    found = re.search(r"is not one of (.*)$|is not (.*)$|; (?:known: )?([^;]*)$", complaint)
    return _cell(next(filter(None, found.groups()), "")) if found else ""


def _end(path: str, kind: type, good: Any, far: Any, takes: Takes) -> Optional[Tuple[float, bool]]:
    """(the last value that is taken towards a far one, whether it is taken itself); None where all
    are."""
    if not takes(path, far):
        return None
    for _ in range(_HALVINGS):
        middle = kind((good + far) / 2) if kind is float else (good + far) // 2
        if middle in (good, far):
            break
        good, far = (middle, far) if not takes(path, middle) else (good, middle)
    if kind is int:
        return good, True
    for digits in range(_DIGITS):
        near = round(good, digits)
        if math.isclose(near, good, rel_tol=1e-6, abs_tol=1e-6):
            return near, not takes(path, kind(near))
    return float(f"{good:.3g}"), True


def _span(low: Optional[Tuple[float, bool]], high: Optional[Tuple[float, bool]]) -> str:
    if low and high and low[1] and high[1]:
        return f"{low[0]:g} to {high[0]:g}"
    parts = [f"{low[0]:g} or more" if low[1] else f"over {low[0]:g}"] if low else []
    parts += [f"at most {high[0]:g}" if high[1] else f"under {high[0]:g}"] if high else []
    return ", ".join(parts)


# ---- the links file, which is no single class ----------------------------------------------------


def _links_rows() -> List[Row]:
    document = _document(_EXAMPLES["links"][0])

    def takes(path: str, value: Any) -> str:
        changed = copy.deepcopy(document)
        key = path.rpartition(".")[2]
        if path.startswith("classes"):
            changed["classes"]["bulk" if key == "codec" else "events"][key] = value
        else:
            rule = next(r for r in changed[SECTIONS[0]] if "codec" in r)
            rule[key] = value
        return _complaint(lambda: parse_links(changed, "file"))

    found = list(_rows(TrafficClass, "classes.NAME.", None, takes))
    rules = [
        (path.replace("traffic", "class"), *rest)
        for path, *rest in _rows(
            RuleEntry,
            "SECTION[].",
            None,
            lambda path, value: takes(path.replace("traffic", "class"), value),
        )
    ]
    names = ", ".join(f"`{s}`" for s in SECTIONS)
    section = ("SECTION", "", "none", "list", f"which topics cross in one direction; {names}")
    return [*found, section, *rules]
