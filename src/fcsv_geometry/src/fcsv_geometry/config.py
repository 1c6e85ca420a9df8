# SPDX-License-Identifier: Apache-2.0
"""Strict configuration: a dataclass is the only home of defaults, a file may only name its
fields."""

import dataclasses
import difflib
import math
import re
import typing
from pathlib import Path
from typing import Any, Collection, Iterable, Mapping, Optional, Tuple, Type, TypeVar

import yaml

from fcsv_geometry import strict_yaml
from fcsv_geometry.errors import ConfigError, GeometryError

T = TypeVar("T")
# by difflib's measure; of a word with two letters exchanged, or one too many, it is above 0.8
_ALIKE = 0.6
_LARGEST_INT = (1 << 63) - 1  # of a message's int64


def load(path, cls: Type[T]) -> T:
    """A dataclass from a YAML file; nested dataclasses and lists of them included.

    A ``ValueError`` raised by a dataclass's ``__post_init__`` ("field: what is wrong") is reported
    with the file's name. Raises ConfigError naming file and field on an unknown key, a missing one,
    a wrong type, NaN, or a value that the dataclass refuses.
    """
    return from_mapping(read_yaml(path), cls, str(path))


def require_positive(rules, but: Collection[str] = ()) -> None:
    """Checks, for a dataclass's ``__post_init__``: ValueError ("field: what is wrong") unless its
    numbers are positive, ``but`` for those of these names."""
    for field in (f for f in dataclasses.fields(rules) if f.name not in but):
        value = getattr(rules, field.name)
        if (
            isinstance(value, (int, float))
            and not isinstance(value, bool)
            and not 0 < value < math.inf
        ):
            raise ValueError(f"{field.name}: must be positive, got {value}")


def require_within(rules, low: float, high: float, *names: str) -> None:
    """Checks, for a dataclass's ``__post_init__``: ValueError ("field: what is wrong") unless the
    fields of these names are from ``low`` to ``high``."""
    for name in names:
        if not low <= getattr(rules, name) <= high:
            raise ValueError(f"{name}: must be {low:g} to {high:g}, got {getattr(rules, name)}")


def require_in_order(rules, *pairs: Tuple[str, str]) -> None:
    """Checks, for a dataclass's ``__post_init__``: ValueError unless of each pair of fields the
    first is not over the second."""
    for low, high in pairs:
        if getattr(rules, low) > getattr(rules, high):
            raise ValueError(f"{low}: {getattr(rules, low)} is over {high} {getattr(rules, high)}")


def require_graded(rules) -> None:
    """Checks, for a dataclass's ``__post_init__``: ValueError unless each ``red_x`` and ``amber_x``
    are in the order of their defaults, or equal."""
    for field in dataclasses.fields(rules):
        red, amber = field.name, field.name.replace("red_", "amber_", 1)
        if red.startswith("red_") and hasattr(rules, amber):
            most = getattr(type(rules), red) > getattr(type(rules), amber)
            require_in_order(rules, (amber, red) if most else (red, amber))


def read_yaml(path) -> Any:
    """The document in a YAML file. Raises ConfigError where it cannot be read or parsed, or where a
    key stands twice."""
    try:
        return strict_yaml.parse(Path(path).read_text())
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        raise ConfigError(
            f"{path}{where}: not valid YAML ({getattr(error, 'problem', error)})"
        ) from error


def from_mapping(
    document: Any, cls: Type[T], source: str, at: str = "", base: Optional[T] = None
) -> T:
    """A dataclass from a parsed mapping; ``source`` and ``at`` name file and field in errors. What
    the mapping does not name is as in ``base``, or the class's default."""
    here = at or "top level"
    if not isinstance(document, Mapping):
        raise ConfigError(
            f"{source}: {here} must be a mapping of {_names(cls)}, got {_kind(document)}"
        )
    hints = typing.get_type_hints(cls)
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init}
    for key in document:
        if key not in fields:
            raise unknown_key(source, at, key, fields)
    for name, f in fields.items():
        required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        if required and name not in document and base is None:
            field = _join(at, name)
            raise ConfigError(f"{source}: '{field}' is missing", field, "is missing")
    values = {
        k: _convert(v, hints[k], source, _join(at, k), _default(fields[k]))
        for k, v in document.items()
    }
    try:
        return cls(**values) if base is None else dataclasses.replace(base, **values)
    except ValueError as error:
        name, _, problem = str(error).partition(": ")  # the contract of load()
        raise ConfigError(f"{source}: {_join(at, str(error))}", _join(at, name), problem) from error
    except GeometryError as error:  # of a camera, which names no field
        raise ConfigError(f"{source}: '{here}': {error}", at, str(error)) from error


def unknown_key(source: str, at: str, key: Any, known: Iterable[str]) -> ConfigError:
    """The error of a key that is not known at ``at``: it names the known ones, and the nearest
    where there is one.

    >>> print(unknown_key("a.yaml", "fence", "radius", ["floor_m", "radius_m"]))
    a.yaml: unknown key 'fence.radius'; known here: floor_m, radius_m; did you mean 'radius_m'?
    """
    field, names = _join(at, key), list(known)
    near = nearest(key, names)
    hint = f"; did you mean '{near}'?" if near else ""
    words = f"{source}: unknown key '{field}'; known here: {', '.join(names)}{hint}"
    return ConfigError(words, field, f"is not known{hint}")


def nearest(key: Any, known: Iterable[str], alike: float = _ALIKE) -> str:
    """The known key that a mistyped one is likely to mean; "" where none is ``alike`` (0..1,
    difflib's measure).

    >>> nearest("baselinem", ["axis", "baseline_m"]), nearest("colour", ["axis", "baseline_m"])
    ('baseline_m', '')
    """
    return next(iter(difflib.get_close_matches(str(key), list(known), n=1, cutoff=alike)), "")


def line_of(text: str, field: str) -> int:
    """Says in which line, from 1 on, a field ("configurations[1].baseline_m") stands; of one that
    is missing its parent's.

    >>> line_of("name: a\\nconfigurations:\\n  - {axis: up}\\n  - axis: a\\n    tilt: 1\\n", "configurations[1].tilt")
    5
    """
    try:
        node = yaml.compose(text)
    except (yaml.YAMLError, RecursionError):
        return 0
    line = 0
    for name, index in re.findall(r"([A-Za-z_]\w*)|\[(\d+)", field):
        if isinstance(node, yaml.MappingNode) and name:
            found = next(((k, v) for k, v in node.value if k.value == name), None)
            if found is None:
                return line
            line, node = found[0].start_mark.line + 1, found[1]
        elif isinstance(node, yaml.SequenceNode) and index and int(index) < len(node.value):
            node = node.value[int(index)]
            line = node.start_mark.line + 1
        else:
            return line
    return line


def _default(field: dataclasses.Field) -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return None if field.default is dataclasses.MISSING else field.default


def _convert(value: Any, kind: Any, source: str, at: str, base: Any = None) -> Any:
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Union:  # Optional[X]
        return None if value is None else _convert(value, args[0], source, at, base)
    if dataclasses.is_dataclass(kind):
        return from_mapping(value, kind, source, at, base)
    if origin in (list, tuple):
        return _convert_sequence(value, origin, args, source, at)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise _wrong(source, at, f"must be a mapping, got {_kind(value)}")
        return {k: _convert(v, args[1], source, f"{at}.{k}") for k, v in value.items()}
    if isinstance(value, int) and abs(value) > _LARGEST_INT and kind in (int, float):
        raise _wrong(source, at, f"is too large, a number of {value.bit_length()} bits")
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if kind is Any:
        return value
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        hint = _yaml_number(value) if kind is float else _in_quotes(value) if kind is str else ""
        raise _wrong(source, at, f"must be {kind.__name__}, got {_kind(value)}{hint}")
    if isinstance(value, float) and not math.isfinite(value):
        raise _wrong(source, at, f"must be finite, got {value}")
    return value


def _yaml_number(value: Any) -> str:
    """How to write a number that YAML takes for a word.

    >>> _yaml_number("1e-3"), _yaml_number("5 m")
    (': write 0.001', '')
    >>> _yaml_number("1e-12")
    ': write 1.0e-12'
    """
    try:
        number = repr(float(value)) if isinstance(value, str) else ""
    except ValueError:
        return ""
    number = number if "." in number else number.replace("e", ".0e")
    return f": write {number}" if number else ""


def _in_quotes(value: Any) -> str:
    """How to write a word that YAML takes for something else.

    >>> print(_in_quotes({"/maps/a": "b"}))
    : put it in quotes, '/maps/a: b' (for roslaunch "'/maps/a: b'")
    """
    if isinstance(value, Mapping) and len(value) == 1:
        ((key, held),) = value.items()
        value = key if held is None else f"{key}: {held}"
    elif value is None or isinstance(value, (Mapping, list, tuple)):
        return ""
    word = str(value)[:80]
    return f""": put it in quotes, '{word}' (for roslaunch "'{word}'")"""


def _convert_sequence(value, origin, args, source, at):
    if not isinstance(value, (list, tuple)):
        raise _wrong(source, at, f"must be a list, got {_kind(value)}")
    fixed = origin is tuple and args[-1] is not Ellipsis
    if fixed and len(value) != len(args):
        raise _wrong(source, at, f"must have {len(args)} values, got {len(value)}")
    kinds = args if fixed else (args[0],) * len(value)
    return origin(
        _convert(v, k, source, f"{at}[{i}]") for i, (v, k) in enumerate(zip(value, kinds))
    )


def _wrong(source: str, at: str, problem: str) -> ConfigError:
    return ConfigError(f"{source}: '{at}' {problem}", at, problem)


def _join(at: str, key: str) -> str:
    return f"{at}.{key}" if at else str(key)


def _names(cls) -> str:
    return ", ".join(f.name for f in dataclasses.fields(cls) if f.init)


def _kind(value: Any) -> str:
    return "nothing" if value is None else f"{type(value).__name__} {value!r}"[:80]
