# SPDX-License-Identifier: Apache-2.0
"""What a node publishes, hears, offers and calls, read from its source and from the ROS modules
that it imports."""

import ast
import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Iterator, List, Mapping, Optional, Set, Tuple
from unittest import mock

#: How a call makes an end of a topic or service, by the last name of what is called.
KINDS = {
    "Publisher": "publishes",
    "Subscriber": "hears",
    "Service": "offers",
    "ServiceProxy": "calls",
    "SimpleActionServer": "offers",
    "SimpleActionClient": "calls",
}
BROADCASTERS = {"TransformBroadcaster": "/tf", "StaticTransformBroadcaster": "/tf_static"}
#: Its functions subscribe for whoever calls them, to topics of tables.
SHARED = "fcsv_geometry.ros.telemetry_messages"
_VEHICLE = {"n", "name", "vehicle", "v", "own", "_name", "_vehicle"}


@dataclass(frozen=True)
class End:
    """One end of a topic, service or action; a part of ``name`` in capitals is given by a
    parameter."""

    does: str
    name: str
    type: str


def module_file(root: Path, module: str) -> Optional[Path]:
    """The source of a module of this workspace."""
    package = module.split(".")[0]
    base = root / "src" / package / "src" / Path(*module.split("."))
    return next((p for p in (base.with_suffix(".py"), base / "__init__.py") if p.is_file()), None)


def ros_modules(root: Path, module: str) -> List[str]:
    """``module`` and those about ROS (in a folder ``ros``) that it imports, directly or not, but
    for SHARED."""
    found: Set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = module_file(root, name)
        if (
            name in found
            or name == SHARED
            or path is None
            or (name != module and ".ros" not in name)
        ):
            continue
        found.add(name)
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("fcsv_"):
                waiting += [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
    return sorted(found)


def ends_of_node(root: Path, module: str) -> Set[End]:
    """Of a node's module and the ROS modules that it imports."""
    found: Set[End] = set()
    for name in ros_modules(root, module):
        path, space = module_file(root, name), vars(importlib.import_module(name))
        found |= ends(path, space) | _shared_ends(path, space)
    return found


def _shared_ends(path: Path, space: Mapping[str, object]) -> Set[End]:
    """What one module hears by the shared functions that it calls: each is called, and what it
    subscribes to noted."""
    found: Set[End] = set()

    def noted(topic, kind, *_, **__):
        found.add(End("hears", topic, kind.__name__))

    for call in _calls(ast.parse(path.read_text())):
        if not _last(call.func).startswith("subscribe"):
            continue
        function = _value(call.func, space)
        if getattr(function, "__module__", "") == SHARED:
            with mock.patch("rospy.Subscriber", noted):
                function(*(_value(a, space) for a in call.args))
    return found


def _value(expr: ast.expr, space: Mapping[str, object]) -> object:
    """Of an expression in a module; what only a running node knows is written as it stands in
    topics."""
    try:
        return eval(compile(ast.Expression(expr), "<topics>", "eval"), dict(space))
    except (NameError, AttributeError):
        return _text(expr, {}) or "VEHICLE"


def ends(path: Path, space: Optional[Mapping[str, object]] = None) -> Set[End]:
    """Of one module; ``space`` are its names, for constants that it imports."""
    tree = _Constants(space or {}).visit(ast.parse(path.read_text()))
    found: Set[End] = set()
    scopes = [(scope, constants, dict(_helpers(scope))) for scope, constants in _scopes(tree)]
    # they count where it is called
    inside = {id(call) for _, _, helpers in scopes for call, _ in helpers.values()}
    for scope, constants, helpers in scopes:
        calls = [c for c in _calls(scope) if id(c) not in inside]
        for env in _environments(scope, constants):
            found |= {e for call in calls for e in _ends_of(call, env, helpers)}
    return found


class _Constants(ast.NodeTransformer):
    """Writes out constants of other modules, imported (``STOP``) or of an imported module
    (``telemetry.HOME``)."""

    def __init__(self, space: Mapping[str, object]):
        self._space = space

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._written(node, self._space.get(node.id))

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        owner = node.value.id if isinstance(node.value, ast.Name) else ""
        found = self._written(node, getattr(self._space.get(owner), node.attr, None))
        return self.generic_visit(node) if found is node else found

    @staticmethod
    def _written(node, value: object) -> ast.expr:
        is_constant = (
            isinstance(value, str) and _last(node).isupper() and isinstance(node.ctx, ast.Load)
        )
        return ast.Constant(value) if is_constant else node


def _scopes(tree: ast.Module) -> Iterator[Tuple[ast.AST, Dict[str, ast.expr]]]:
    """Functions, and the module's constants."""
    constants = {
        t.id: n.value
        for n in tree.body
        if isinstance(n, ast.Assign)
        for t in n.targets
        if _named(t)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            local = {
                t.id: n.value
                for n in ast.walk(node)
                if isinstance(n, ast.Assign)
                for t in n.targets
                if _named(t)
            }
            yield node, {**constants, **local}


def _named(target) -> bool:
    return isinstance(target, ast.Name)


def _environments(scope: ast.AST, constants: Dict[str, ast.expr]) -> Iterator[Dict[str, ast.expr]]:
    """As often as a loop over written values turns; other loops leave their variable open."""
    yield constants
    for loop in ast.walk(scope):
        if not isinstance(loop, (ast.For, ast.comprehension)) or not isinstance(
            loop.iter, (ast.Tuple, ast.List)
        ):
            continue
        for value in loop.iter.elts:
            if isinstance(loop.target, ast.Name):
                yield {**constants, loop.target.id: value}
            elif isinstance(value, ast.Tuple):
                names = [getattr(t, "id", "") for t in loop.target.elts]
                yield {**constants, **dict(zip(names, value.elts))}


def _calls(scope: ast.AST) -> List[ast.Call]:
    return [n for n in ast.walk(scope) if isinstance(n, ast.Call)]


def _helpers(scope: ast.AST) -> Iterator[Tuple[str, Tuple[ast.Call, List[str]]]]:
    """Local functions that make an end out of their arguments: the call inside, and the arguments'
    names."""
    for node in ast.walk(scope):
        inner, name = None, ""
        if isinstance(node, ast.FunctionDef) and node is not scope:
            inner, name = node, node.name
        elif (
            isinstance(node, ast.Assign)
            and isinstance(node.value, ast.Lambda)
            and _named(node.targets[0])
        ):
            inner, name = node.value, node.targets[0].id
        if inner is not None:
            for call in _calls(inner):
                if _last(call.func) in KINDS:
                    yield name, (call, [a.arg for a in inner.args.args])


def _ends_of(call: ast.Call, env: Dict[str, ast.expr], helpers) -> Iterator[End]:
    what = _last(call.func)
    if what in BROADCASTERS:
        yield End("publishes", BROADCASTERS[what], "tf2_msgs/TFMessage")
    elif what in KINDS and len(call.args) >= 2:
        yield from _end(what, call.args[0], call.args[1], env)
    elif what in helpers:
        inner, arguments = helpers[what]
        bound = {**env, **dict(zip(arguments, call.args))}
        if len(inner.args) >= 2:
            yield from _end(_last(inner.func), inner.args[0], inner.args[1], bound)


def _end(what: str, topic: ast.expr, kind: ast.expr, env: Dict[str, ast.expr]) -> Iterator[End]:
    name, message = _text(topic, env), _type(kind, env)
    if name is not None and message is not None:
        yield End(KINDS[what], name, message)


def _last(func: ast.expr) -> str:
    return func.attr if isinstance(func, ast.Attribute) else getattr(func, "id", "")


def _text(expr: ast.expr, env: Dict[str, ast.expr], depth: int = 0) -> Optional[str]:
    """A name as written; what it is put together from in capitals. None: nothing of it is written
    here."""
    if isinstance(expr, ast.Constant):
        return str(expr.value)
    if isinstance(expr, ast.JoinedStr):
        return "".join(_part(v, env, depth) for v in expr.values)
    if isinstance(expr, ast.Name) and expr.id in env and depth < 5:
        return _text(env[expr.id], env, depth + 1)
    if isinstance(expr, ast.BinOp) and isinstance(expr.op, ast.Add):
        parts = [_text(e, env, depth) for e in (expr.left, expr.right)]
        return None if None in parts else "".join(parts)
    if isinstance(expr, ast.IfExp):
        return _text(expr.body, env, depth) or _text(expr.orelse, env, depth)
    return None


def _part(value: ast.expr, env: Dict[str, ast.expr], depth: int) -> str:
    if isinstance(value, ast.Constant):
        return value.value
    inner = value.value
    known = _text(inner, env, depth + 1) if depth < 5 else None
    if known is not None:
        return known
    word = _last(inner) if isinstance(inner, (ast.Attribute, ast.Name)) else "NAME"
    return "VEHICLE" if word in _VEHICLE else word.strip("_").upper()


def _type(expr: ast.expr, env: Dict[str, ast.expr]) -> Optional[str]:
    if isinstance(expr, ast.Name) and expr.id in env:
        expr = env[expr.id]
    name = _last(expr)
    return name if name[:1].isupper() else None
