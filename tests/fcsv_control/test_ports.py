# SPDX-License-Identifier: Apache-2.0
"""No core is made or called outside of its port: what nodes and rehearsal have in common is the
port, not a copy."""

import ast

import pytest

#: Core -> where it may be named besides the package of its port; add a row for each port.
CORES = {
    "MissionMachine": "fcsv_sim/rehearsal/control.py",  # to look at: a property's type
    "OperatorCommands": "",
    "Guardian": "fcsv_sim/rehearsal/board.py",  # likewise
    "VehicleTelemetry": "",
    "TagInFront": "",
    "PairsSeen": "",
    "TimeOfDay": "",
    "PairsToLookAt": "",
    "DiskWatch": "",
    "Drift": "",
    "stale_reason": "",
    "StopAll": "",
    "Judged": "",
    "FleetTable": "",
    "Digest": "",
    "Pace": "",
    "Acceptances": "",
    "AgentCore": "",
    "LinkRequests": "",
    "LinkCore": "",
    "MavrosCore": "",
    "PoseGate": "",
    "PoseCheck": "",
    "PoseWatchdog": "",
    "BodyOdometry": "",
    "DuplicateAgentGuard": "",
    "CalibrationSession": "",
    "calibrate_link": "",
    "merge_loops": "",
}
_CALLED = ("machine", "guardian", "check")  # attributes that hold a core: read, never called


def adapters(root):
    """The files that adapt ports: all nodes, and the rehearsal."""
    nodes = (p for p in root.glob("src/*/src/*/**/*.py") if "ros" in p.parts)
    found = [*nodes, *root.glob("src/fcsv_sim/src/fcsv_sim/rehearsal/**/*.py")]
    assert len(found) > 50
    return found


def called_on_a_core(tree):
    """Names of methods called on an attribute that holds a core: x.machine.abort(...)."""
    calls = [
        n.func
        for n in ast.walk(tree)
        if isinstance(n, ast.Call) and isinstance(n.func, ast.Attribute)
    ]
    on = [(c.value, c.attr) for c in calls if isinstance(c.value, ast.Attribute)]
    return [
        f"{v.attr}.{name}"
        for v, name in on
        if v.attr in _CALLED or (v.attr == "core" and _is_port(v.value))
    ]


def _is_port(value):
    return getattr(value, "attr", getattr(value, "id", "")).endswith("port")


def imported(tree):
    return {a.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names}


@pytest.mark.parametrize("core", CORES)
def test_no_adapter_names_a_core(root, core):
    names = [str(p) for p in adapters(root) if core in imported(ast.parse(p.read_text()))]
    allowed = CORES[core]
    assert [n for n in names if not (allowed and n.endswith(allowed))] == []


def test_no_adapter_calls_a_core(root):
    calls = {str(p): called_on_a_core(ast.parse(p.read_text())) for p in adapters(root)}
    assert {p: c for p, c in calls.items() if c} == {}


def test_a_call_on_a_core_is_found():
    assert called_on_a_core(ast.parse("flight.control.machine.abort('now')")) == ["machine.abort"]
    call = ast.parse("vehicle.link.port.core.receive(now_s, m)")
    assert called_on_a_core(call) == ["core.receive"]
    assert called_on_a_core(ast.parse("flight.control.machine.problems.copy()")) == []
    assert called_on_a_core(ast.parse("rospy.core.is_shutdown_requested()")) == []
