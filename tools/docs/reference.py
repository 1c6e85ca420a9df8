# SPDX-License-Identifier: Apache-2.0
"""Writes docs/reference/: nodes, commands, packages, launch and other files as the code has them.
--check compares."""

import argparse
import ast
import contextlib
import dataclasses
import importlib
import inspect
import os
import re
import runpy
import sys
import xml.etree.ElementTree as xml
from pathlib import Path
from typing import Callable, Dict, List, Optional, Tuple

import files_page
import ways_page
from field_notes import notes_of
from node_topics import ends_of_node, module_file, ros_modules

ROOT = Path(__file__).resolve().parents[2]
PLACE = ROOT / "docs" / "reference"
_HEAD = "<!-- Written by `tools/run reference` from the code: do not edit. -->\n"
_CORES = 7919  # stands for the number of cores, which differs from machine to machine


class Parsed(BaseException):
    """A program came to its arguments: it is a command."""

    def __init__(self, parser: argparse.ArgumentParser):
        self.parser = parser


class Began(BaseException):
    """A program became a node before it had arguments."""


def executables() -> List[Path]:
    """Of all packages, in order."""
    return sorted(p for p in ROOT.glob("src/fcsv_*/nodes/*") if p.is_file())


def package_of(executable: Path) -> str:
    return executable.parents[1].name


def entry_module(executable: Path) -> str:
    """The module whose ``main`` an executable runs."""
    for node in ast.walk(ast.parse(executable.read_text())):
        if isinstance(node, ast.ImportFrom) and any(a.name == "main" for a in node.names):
            return node.module
    raise SystemExit(f"{executable}: imports no main")


@contextlib.contextmanager
def _stopped():
    """Programs end where they parse arguments, or begin to be nodes."""
    import rospy

    def parse(self, args=None, namespace=None):
        raise Parsed(self)

    def begin(*_, **__):
        raise Began

    kept = (argparse.ArgumentParser.parse_args, rospy.init_node, os.cpu_count, sys.argv)
    argparse.ArgumentParser.parse_args, rospy.init_node, os.cpu_count = parse, begin, lambda: _CORES
    try:
        yield
    finally:
        argparse.ArgumentParser.parse_args, rospy.init_node, os.cpu_count, sys.argv = kept


def parser_of(executable: Path) -> Optional[argparse.ArgumentParser]:
    """The arguments of a command; None for a node."""
    if not re.search(
        r"ArgumentParser|_parser?\(", module_file(ROOT, entry_module(executable)).read_text()
    ):
        return None
    sys.argv = [str(executable)]
    try:
        runpy.run_path(str(executable), run_name="__main__")
    except Parsed as parsed:
        return parsed.parser
    except Began:
        return None
    raise SystemExit(f"{executable}: neither parses arguments nor becomes a node")


# ---- commands ------------------------------------------------------------------------------------


def commands_page(parsers: Dict[Path, argparse.ArgumentParser]) -> str:
    """docs/reference/commands.md."""
    lines = [
        _HEAD,
        "# Commands",
        "",
        "Every command and its options. Each says the same with `--help`.",
        "",
    ]
    for path, parser in parsers.items():
        lines += [f"## {path.name}", "", f"`rosrun {package_of(path)} {path.name}`", ""]
        lines += [_sentence(parser.description), ""] if parser.description else []
        lines += _arguments(parser)
        if parser.epilog:
            lines += ["```text", *_tidy(parser.epilog).strip("\n").splitlines(), "```", ""]
    return "\n".join(lines).rstrip() + "\n"


def _arguments(parser: argparse.ArgumentParser, under: str = "") -> List[str]:
    rows, below = [], []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, sub in action.choices.items():
                words = (
                    next((a.help for a in action._choices_actions if a.dest == name), None)
                    or sub.description
                )
                below += [
                    f"### {under}{parser.prog.split()[-1]} {name}",
                    "",
                    _sentence(words or ""),
                    "",
                ]
                below += _arguments(sub)
        elif not isinstance(action, argparse._HelpAction) and action.help != argparse.SUPPRESS:
            rows.append(f"| {_names(action)} | {_cell(_meaning(action, parser))} |")
    head = ["| argument | meaning |", "|---|---|"] if rows else []
    return [*head, *rows, *([""] if rows else []), *below]


def _names(action: argparse.Action) -> str:
    if not action.option_strings:
        name = action.metavar or action.dest
        return f"`{name}{' ...' if action.nargs in ('+', '*') else ''}`"
    value = ""
    if action.nargs != 0:
        metavar = action.metavar or (None if action.choices else action.dest.upper())
        value = " " + (" ".join(metavar) if isinstance(metavar, tuple) else metavar or "CHOICE")
    return f"`{', '.join(action.option_strings)}{value}`"


def _meaning(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    values = {**vars(action), "prog": parser.prog}
    text = (action.help or "") % values if action.help else ""
    parts = [_sentence(text)] if text else []
    if action.choices:
        parts.append("One of " + ", ".join(f"`{c}`" for c in action.choices) + ".")
    if action.required and action.option_strings:
        parts.append("Must be given.")
    default = action.default
    shown = default not in (None, False, "", argparse.SUPPRESS) and "default" not in text
    if shown and action.option_strings:
        words = " ".join(map(str, default)) if isinstance(default, (list, tuple)) else str(default)
        parts.append(f"Default: `{words}`.")
    return _tidy(" ".join(parts)).replace(f"`{_CORES}`", "the number of cores")


# ---- nodes ---------------------------------------------------------------------------------------


def nodes_page(nodes: List[Path]) -> str:
    """docs/reference/nodes.md."""
    lines = [
        _HEAD,
        "# Nodes",
        "",
        "Every node: what it is for, its topics and services, its parameters with their defaults. A part of a name in "
        "capitals (`/VEHICLE/odometry/state`) is given by a parameter. A name without a slash is in the node's "
        "namespace (a vehicle's), one with `~` below the node's own name. Meanings of topics: "
        "[architecture.md](../design/architecture.md#machines-and-topics).",
        "",
    ]
    for path in nodes:
        module = entry_module(path)
        lines += [f"## {package_of(path)}/{path.name}", "", _sentence(_first_line(module)), ""]
        told = sorted((e.does, e.name, e.type) for e in ends_of_node(ROOT, module))
        rows = [f"| {does} | `{name}` | `{kind}` |" for does, name, kind in told]
        lines += (
            ["| | name | type |", "|---|---|---|", *rows, ""]
            if rows
            else ["It has no topic of its own.", ""]
        )
        lines += _parameters(module)
    return "\n".join(lines).rstrip() + "\n"


def _first_line(module: str) -> str:
    return (ast.get_docstring(ast.parse(module_file(ROOT, module).read_text())) or "").split(
        "\n\n"
    )[0]


def _parameters(module: str) -> List[str]:
    """The dataclass that the node reads its parameters into (``node.parameters(...)``)."""
    for name in [module, *ros_modules(ROOT, module)]:
        for node in ast.walk(ast.parse(module_file(ROOT, name).read_text())):
            if (
                isinstance(node, ast.Call)
                and getattr(node.func, "attr", "") == "parameters"
                and node.args
            ):
                cls = getattr(importlib.import_module(name), node.args[0].id)
                rows = [
                    f"| `~{k}` | `{kind}` | {default} | {_cell(note)} |"
                    for k, kind, default, note in fields(cls)
                ]
                return (
                    ["| parameter | type | default | |", "|---|---|---|---|", *rows, ""]
                    if rows
                    else []
                )
    return []


def fields(cls, above: str = "") -> List[Tuple[str, str, str, str]]:
    """Name, type, default and the comment beside it, nested ones with their path."""
    notes, types, found = notes_of(cls), _written(cls, r"([^=#\n]+)"), []
    for f in dataclasses.fields(cls):
        default = f.default
        if default is dataclasses.MISSING and f.default_factory is not dataclasses.MISSING:
            default = f.default_factory()
        if dataclasses.is_dataclass(default):
            found += fields(type(default), f"{above}{f.name}/")
            continue
        shown = "must be given" if default is dataclasses.MISSING else f"`{_shown(default)}`"
        found.append(
            (above + f.name, types.get(f.name, "").strip(), _tidy(shown), notes.get(f.name, ""))
        )
    return found


def _shown(default) -> str:
    return "none" if default is None else '""' if default == "" else str(default)


def _written(cls, what: str) -> Dict[str, str]:
    """By field: what stands in the source behind its name and colon."""
    try:
        source = inspect.getsource(cls)
    except (OSError, TypeError):
        return {}
    return dict(re.findall(rf"^    (\w+): {what}", source, re.M))


# ---- packages ------------------------------------------------------------------------------------


def packages_page() -> str:
    """docs/reference/packages.md."""
    lines = [
        _HEAD,
        "# Packages",
        "",
        "Every folder of Python modules, by the first sentence of its `__init__.py`.",
        "",
    ]
    # an install leaves *.egg-info beside the packages
    for top in sorted(p.parent for p in ROOT.glob("src/fcsv_*/src/fcsv_*/__init__.py")):
        lines += [f"## {top.name}", "", _folder_is(top), ""]
        rooms = sorted(f.parent for f in top.rglob("*/__init__.py"))
        rows = [f"| `{r.relative_to(top)}/` | {_cell(_folder_is(r))} |" for r in rooms]
        lines += ["| folder | what it holds |", "|---|---|", *rows, ""] if rows else []
    return "\n".join(lines).rstrip() + "\n"


def _folder_is(folder: Path) -> str:
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))
    if not text:
        raise SystemExit(f"{folder.relative_to(ROOT)}/__init__.py: has no docstring")
    return _sentence(text.split("\n\n")[0])


# ---- launch files --------------------------------------------------------------------------------


def launch_page() -> str:
    """docs/reference/launch.md."""
    lines = [
        _HEAD,
        "# Launch files",
        "",
        "Of `fcsv_bringup`, for roslaunch, with arguments `NAME:=VALUE`.",
        "",
    ]
    for path in sorted((ROOT / "launch").rglob("*.launch")):
        name, text = path.relative_to(ROOT / "launch"), path.read_text()
        lines += [f"## {name}", ""]
        comment = re.search(r"<!--(.*?)-->", text, re.S)
        if comment:
            said = [line.strip() for line in comment.group(1).splitlines() if "SPDX" not in line]
            lines += [*_words_and_commands(said), ""]
        rows = []
        for arg in xml.fromstring(text).findall("arg"):
            if arg.get("value") is None:
                default = arg.get("default")
                shown = (
                    "must be given" if default is None else f"`{default}`" if default else "empty"
                )
                rows.append(
                    f"| `{arg.get('name')}` | {_cell(shown)} | {_cell(arg.get('doc') or '')} |"
                )
        lines += ["| argument | default | |", "|---|---|---|", *rows, ""] if rows else []
    return "\n".join(lines).rstrip() + "\n"


def _words_and_commands(lines: List[str]) -> List[str]:
    """A comment's commands in a block of their own."""
    found: List[str] = []
    for line in filter(None, lines):
        command = re.match(r"(ROS_IP=\S+ )?(roslaunch|rosrun) ", line)
        found += ["", "```text", line, "```", ""] if command else [line]
    return found


# ---- writing -------------------------------------------------------------------------------------


def _sentence(text: str) -> str:
    text = _tidy(" ".join(text.split()))
    return text if not text or text.endswith((".", ":", "!")) else text + "."


def _tidy(text: str) -> str:
    return text.replace(str(ROOT) + "/", "")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def pages() -> Dict[str, str]:
    """File name and text."""
    with _stopped():
        parsers = {path: parser_of(path) for path in executables()}
    commands = {path: parser for path, parser in parsers.items() if parser is not None}
    nodes = [p for p, parser in parsers.items() if parser is None]
    return {
        "commands.md": commands_page(commands),
        "nodes.md": nodes_page(nodes),
        "packages.md": packages_page(),
        "launch.md": launch_page(),
        "files.md": files_page.page(_HEAD),
        "ways.md": ways_page.page(_HEAD, ROOT),
    }


def main(write: Callable[[Path, str], None] = lambda path, text: path.write_text(text)) -> int:
    """Exit status 1 where --check finds a page that is not as the code has it."""
    checks = sys.argv[1:] == ["--check"]
    PLACE.mkdir(exist_ok=True)
    stale = []
    for name, text in pages().items():
        path = PLACE / name
        if not path.is_file() or path.read_text() != text:
            stale.append(path)
            if not checks:
                write(path, text)
    for path in stale:
        print(
            f"{path.relative_to(ROOT)}: {'is not as the code has it: tools/run reference' if checks else 'written'}"
        )
    return int(checks and bool(stale))


if __name__ == "__main__":
    sys.exit(main())
