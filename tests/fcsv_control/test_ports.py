# SPDX-License-Identifier: Apache-2.0
"""One wiring: what decides is called by its port alone, never by a node or by the rehearsal."""

import ast
from pathlib import Path

import pytest

import fcsv_control
import fcsv_sim

_CONTROL, _SIM = Path(fcsv_control.__file__).parent, Path(fcsv_sim.__file__).parent
FOLDERS = (_CONTROL / "ros", _SIM / "rehearsal")
#: Class: its module, and how it is named where somebody holds one.
CORES = {"Guardian": (_CONTROL / "guardian/core.py", {"guardian", "guardian_port.core", "_port.core"})}


def methods(name: str, module: Path):
    """What a core is told and asked; properties are for looking."""
    tree = ast.parse(module.read_text())
    core = next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == name)
    found = [n for n in core.body if isinstance(n, ast.FunctionDef) and not n.name.startswith("_")]
    return {n.name for n in found if not any(isinstance(d, ast.Name) and d.id == "property" for d in n.decorator_list)}


def dotted(node) -> str:
    """A name with its dots; empty for what is none."""
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def calls(source: str, name: str, called, holders):
    """(line, text) of each call on a core, or that makes one."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        text = dotted(node.func)
        holder, _, method = text.rpartition(".")
        held = any(holder == h or holder.endswith(f".{h}") for h in holders)
        if method == name or (held and method in called):
            yield node.lineno, text


@pytest.mark.parametrize("name", CORES)
def test_no_core_is_called_outside_of_its_port(name):
    module, holders = CORES[name]
    called = methods(name, module)
    assert {"step", "outgoing"} <= called
    found = [
        f"{path.name}:{line}: {text}"
        for folder in FOLDERS
        for path in sorted(folder.glob("*.py"))
        for line, text in calls(path.read_text(), name, called, holders)
    ]
    assert not found, "; ".join(found)


def test_such_a_call_is_found():
    told = "self.guardian.feed(1.0, T)\nself.guardian_port.receive(1.0, m)\n"
    source = "g = Guardian()\nv.guardian.verdict.in_words\n" + told
    assert [line for line, _ in calls(source, "Guardian", {"feed", "step"}, {"guardian"})] == [1, 3]
