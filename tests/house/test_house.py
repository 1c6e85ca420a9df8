# SPDX-License-Identifier: Apache-2.0
"""The house rules that a machine can check: who may import whom, and what may not stand in the
tree."""

import ast
import dataclasses
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROS_MODULES = {
    "rospy",
    "rosbag",
    "tf2_ros",
    "cv_bridge",
    "message_filters",
    "diagnostic_updater",
    "actionlib",
    "fcsv_msgs",
    "mavros_msgs",
}
BELOW = {
    "fcsv_geometry": set(),
    "fcsv_tracking": {"fcsv_geometry"},
    "fcsv_stereo": {"fcsv_geometry"},
    "fcsv_guidance": {"fcsv_geometry", "fcsv_stereo", "fcsv_tracking"},
    "fcsv_multimaster": {"fcsv_geometry"},
    "fcsv_control": {"fcsv_geometry", "fcsv_tracking", "fcsv_stereo"},
    "fcsv_sim": {"fcsv_geometry", "fcsv_tracking", "fcsv_stereo", "fcsv_control", "fcsv_guidance"},
    "fcsv_console": {
        "fcsv_geometry",
        "fcsv_tracking",
        "fcsv_stereo",
        "fcsv_control",
        "fcsv_multimaster",
    },
}


def modules(package):
    found = sorted((ROOT / "src" / package / "src" / package).rglob("*.py"))
    assert found, f"{package} has no modules"
    return found


def imports(path):
    """(module, whether it stands at the module's top) of every import."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        names += (
            [node.module]
            if isinstance(node, ast.ImportFrom) and node.module and not node.level
            else []
        )
        for name in names:
            yield name.split(".")[0], node in tree.body


@pytest.mark.parametrize("package", BELOW)
def test_imports_run_down_only(package):
    allowed = BELOW[package] | {package, "fcsv_msgs"}
    for path in modules(package):
        above = {m for m, _ in imports(path) if m.startswith("fcsv_")} - allowed
        assert not above, f"{path.relative_to(ROOT)} imports {above}"


@pytest.mark.parametrize("package", BELOW)
def test_algorithms_import_no_ros(package):
    for path in modules(package):
        if "ros" in path.relative_to(ROOT / "src" / package / "src" / package).parts[:-1]:
            continue
        found = {
            m for m, at_top in imports(path) if (m in ROS_MODULES or m.endswith("_msgs")) and at_top
        }
        assert not found, f"{path.relative_to(ROOT)} imports {found}; nodes live in ros/"


_KNOWS_TRUTH = "fcsv_sim.truth"
_FLIES_TELLOS = ("fcsv_sim/people/tello_hands.py", "fcsv_sim/ros/tello_pilots_node.py")


def reached(name, seen):
    """Modules of this workspace that importing one imports, itself among them."""
    path = ROOT / "src" / name.split(".")[0] / "src" / (name.replace(".", "/") + ".py")
    if name in seen or not path.is_file():
        return seen
    seen.add(name)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
        else:
            continue
        for each in names:
            reached(each, seen)
    return seen


def flies_tellos():
    own = [p for p in modules("fcsv_control") if p.parent.name == "tello"]
    return [*(str(p.relative_to(ROOT / "src/fcsv_control/src")) for p in own), *_FLIES_TELLOS]


@pytest.mark.parametrize("path", flies_tellos())
def test_nobody_who_flies_a_tello_can_read_the_simulations_truth(path):
    """Controllers, the link and the pilots of simulated Tellos know what the tracker and the
    screens say."""
    name = path[: -len(".py")].replace("/", ".")
    found = reached(name, set())
    assert name in found and _KNOWS_TRUTH not in found, sorted(found)


def test_who_reads_the_truth_is_found_also_where_another_module_does_it():
    assert _KNOWS_TRUTH in reached("fcsv_sim.tello.vehicle", set())


def test_no_demo_reads_the_truth_while_it_flies():
    """What they compare with it afterwards comes from the session."""
    demo = [
        p for p in modules("fcsv_sim") if p.parent.name == "demo" or p.parent.parent.name == "demo"
    ]
    assert len(demo) > 10 and not [p.name for p in demo if _KNOWS_TRUTH in p.read_text()]


def tracked():
    names = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split("\n")
    return [ROOT / n for n in names if n and (ROOT / n).is_file() and not (ROOT / n).is_symlink()]


def test_every_source_file_names_its_licence():
    code = [
        p
        for p in tracked()
        if p.suffix == ".py" or "nodes" in p.parts or p.suffix in (".sh", ".launch")
    ]
    assert code and not [
        str(p.relative_to(ROOT))
        for p in code
        if "SPDX-License-Identifier" not in p.read_text()[:300]
    ]


def test_no_path_of_a_machine_stands_in_the_tree():
    pattern = re.compile(r"(?<![\w.$~/-])/(work|home/\w+|root)/")
    texts = [
        p
        for p in tracked()
        if p.suffix in {".py", ".sh", ".md", ".yaml", ".launch", ".rviz", ".toml", ".txt", ""}
    ]
    assert not [
        str(p.relative_to(ROOT)) for p in texts if pattern.search(p.read_text(errors="ignore"))
    ]


def test_linter():
    result = subprocess.run(
        [ROOT / ".venv/bin/ruff", "check", "src", "tests", "tools"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout[-3000:]


#: Of Python's and other people's modules, which offer nothing public in their place.
_FOREIGN_PRIVATE = set(
    "_HelpAction _SubParsersAction _actions _choices_actions _exit _full_text _md5sum _type".split()
)


def private_names_reached(path):
    """Private names that a file takes from a package of the workspace, or from an object of a class
    that the file does not define."""
    tree = ast.parse(path.read_text())
    own = {
        name
        for node in ast.walk(tree)
        for name in (
            [node.name]
            if isinstance(node, (ast.FunctionDef, ast.ClassDef))
            else [node.attr]
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)
            else [node.target.id]
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
            else [t.id for t in node.targets if isinstance(t, ast.Name)]
            if isinstance(node, ast.Assign)
            else []
        )
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield from (a.name for a in node.names if re.match(r"_[^_]", a.name))
        elif isinstance(node, ast.Attribute) and re.match(r"_[^_]", node.attr):
            inherited = isinstance(node.value, ast.Call) and ast.dump(node.value.func) == ast.dump(
                ast.parse("super", mode="eval").body
            )
            if inherited or node.attr not in own | _FOREIGN_PRIVATE:
                yield node.attr


def test_no_tool_reaches_into_private_names():
    """What a bench or a script needs of a package is public, so that a change of the package's
    inside breaks no tool."""
    found = {
        str(p.relative_to(ROOT)): set(private_names_reached(p))
        for p in (ROOT / "tools").rglob("*.py")
    }
    assert len(found) > 40 and {name: names for name, names in found.items() if names} == {}


def tree_of_tests():
    found = sorted((ROOT / "tests").rglob("*.py"))
    assert len(found) > 50
    return found


def test_tests_import_no_other_tests():
    """What several tests share stands in tests/support; it imports no test either."""
    for path in tree_of_tests():
        whole = {m for m, _ in imports(path)}
        others = {m for m in whole if m.startswith("test_") or m == "conftest"} | (
            whole & {"tests"}
        )
        assert not others, (
            f"{path.relative_to(ROOT)} imports {others}; what tests share stands in tests/support"
        )
    loose = {p.name for p in (ROOT / "tests").glob("*/*.py")} - {
        p.name for p in (ROOT / "tests/support").glob("*.py")
    }
    assert not {
        name
        for name in loose
        if not name.startswith("test_") and name not in ("conftest.py", "__init__.py")
    }


def test_bounds_come_from_measurements_and_not_from_issues():
    """A reader of the tests sees no issue; a bound names its benchmark, its equation, or what was
    measured and when."""
    names = {str(p.relative_to(ROOT)): p for p in tree_of_tests() if p != Path(__file__).resolve()}
    assert not {
        name for name, path in names.items() if re.search(r"\bissues?\b", path.read_text(), re.I)
    }


JOINT_FROM_THE_GROUND = [
    {"tuning"},
    {"bands"},
    {"projecting"},
    {"views"},
    {"pictures"},
    {"volume"},
    {"surfaces"},
    {"refine"},
    {"checks"},
    {"bars"},
    {"match", "pairs"},
    {"method"},
]


def test_stages_of_joint_import_downward_only():
    """The order that the package's docstring states; a stage may import from itself."""
    root = ROOT / "src/fcsv_stereo/src/fcsv_stereo/joint"
    level = {name: i for i, names in enumerate(JOINT_FROM_THE_GROUND) for name in names}
    found = {p.stem if p.is_file() else p.name for p in root.iterdir()} - {
        "__init__",
        "__pycache__",
    }
    assert found == set(level), "a part of joint stands in no order"
    for path in root.rglob("*.py"):
        own = path.relative_to(root).with_suffix("").parts[0]
        if own == "__init__":
            continue  # it offers what the package has
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
            names += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                if not name.startswith("fcsv_stereo.joint"):
                    continue
                parts = name.split(".")
                assert len(parts) > 2, f"{path.relative_to(root)} imports the whole of joint"
                below = parts[2] == own or level[parts[2]] < level[own]
                assert below, (
                    f"{path.relative_to(root)} imports {name}, which does not stand below it"
                )


_UNKNOWN = {"chosen": "not recorded", "same": "not varied"}


def test_every_tuned_number_says_its_unit_and_what_it_trades():
    from fcsv_stereo.joint.tuning import STAGES

    numbers = [f for stage in STAGES for f in dataclasses.fields(stage)]
    assert all(type(stage).__dataclass_params__.frozen for stage in STAGES)
    assert [
        f.name
        for f in numbers
        if not f.metadata["unit"].strip() or not f.metadata["trades"].strip()
    ] == []
    unrecorded, unvaried = (
        sum(f.metadata[key] == value for f in numbers) for key, value in _UNKNOWN.items()
    )
    assert len(numbers) <= 146 and unrecorded <= 70 and unvaried <= 127, (
        "a new number says where it was chosen"
    )


def test_every_process_becomes_a_node_by_the_one_way_that_forgets_no_publisher():
    """``node.begin`` mends rospy before it calls ``init_node``; reference.py and tests only take
    its place."""
    own = ROOT / "src/fcsv_geometry/src/fcsv_geometry/ros/node.py"
    files = [
        p for folder in ("src", "tools", "tests") for p in (ROOT / folder).rglob("*.py") if p != own
    ]
    call = "rospy." + "init_node("
    assert not [str(p.relative_to(ROOT)) for p in files if call in p.read_text()]


def compiled(function):
    return any("njit" in ast.dump(d) for d in function.decorator_list)


def test_numbers_of_joint_stand_in_tuning():
    """Neither a name at the top of a module nor a compiled function of joint holds a number of its
    own.

    Halves and the numbers of colours and of bits are arithmetic; what is below 1e-8 or above 1e5
    keeps a value finite or means none; the cubic's are those of its formula.
    """
    root = ROOT / "src/fcsv_stereo/src/fcsv_stereo/joint"
    bare = []
    for path in sorted(root.rglob("*.py")):
        if "tuning" in path.parts:
            continue
        for node in ast.parse(path.read_text()).body:
            kernel = isinstance(node, ast.FunctionDef) and compiled(node) and node.name != "_cubic"
            if kernel or isinstance(node, ast.Assign):
                numbers = [
                    n.value
                    for n in ast.walk(node)
                    if isinstance(n, ast.Constant) and type(n.value) is float
                ]
                bare += [
                    f"{path.name}: {n}"
                    for n in numbers
                    if 1e-8 < n < 1e5 and n not in (0.5, 1.0, 2.0, 3.0, 32.0)
                ]
    assert not bare


def definitions(kinds):
    """(path, node) of what the packages define."""
    for package in BELOW:
        for path in modules(package):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, kinds):
                    yield path, node


def test_no_class_name_stands_twice():
    places = {}
    for path, node in definitions(ast.ClassDef):
        places.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    twice = {name: found for name, found in places.items() if len(found) > 1}
    assert len(places) > 800 and twice == {}


#: They name neither what is done nor what it is done to: "One word for each thing" of the style.
_NO_NAMES = set("take told heard said hear see feed judge".split())


def words_of(name):
    """The words of a name, in lower case; "take off" and "take over" are terms of flight.

    >>> words_of("_hear_relay"), words_of("GoalTold"), words_of("_take_off")
    (['hear', 'relay'], ['goal', 'told'], ['off'])
    """
    found = [w.lower() for w in re.findall(r"[A-Z]?[a-z0-9]+", name)]
    flight = {"off", "over"} & set(found)
    return [w for w in found if not (w == "take" and flight)]


def test_names_are_verbs_and_nouns_of_the_field():
    found = [
        f"{path.relative_to(ROOT)}: {node.name}"
        for path, node in definitions((ast.FunctionDef, ast.ClassDef))
        if _NO_NAMES & set(words_of(node.name))
    ]
    assert found == []


PROGRESS = set("phase activity stage configuration moment task leg station state".split())


def test_the_glossary_of_progress_says_where_each_word_is_defined():
    """A row of conventions.md: a word, what it is, and the name in the code that has it."""
    text = (ROOT / "docs/design/conventions.md").read_text()
    rows = re.findall(r"^\| \*(\w+)\* \| .+ \| `([\w/.]+):(\w+)` \|$", text, re.M)
    assert {word for word, _, _ in rows} == PROGRESS and len(rows) == len(PROGRESS)
    for word, place, name in rows:
        path = ROOT / "src" / place
        assert path.is_file() and re.search(rf"\b{name}\b", path.read_text()), (word, place, name)
        assert word[:6] in f"{place}:{name}".lower(), (word, place, name)


#: First words of a docstring that says of nothing what it is.
_NO_SENTENCE = set(
    "after as at before besides by for from in likewise of on over to under until with without".split()
)


def test_docstrings_begin_with_what_it_is_or_does():
    found = [
        (path, node, ast.get_docstring(node))
        for path, node in definitions((ast.FunctionDef, ast.ClassDef))
    ]
    words = [
        (f"{p.relative_to(ROOT)}:{n.lineno}", re.match(r"\w*", d)[0].lower())
        for p, n, d in found
        if d
    ]
    assert len(words) > 4000 and [place for place, word in words if word in _NO_SENTENCE] == []


_READ = r"texts?|words"  # of files and arguments, too, which are taken apart
_TEXTS = re.compile(
    rf"{_READ}|(detail|reason|problem|message|refusal|note)s?|refused|said|told|why|sender"
)
#: where the words are another program's, which says it in no other way
_FOREIGN_WORDS = {
    "flight_check/pre_arm_texts.py": "PreArm: of the autopilot",
    "flight/mavros.py": "Mode change to, of the autopilot",
    "parameters/vehicle.py": "signing, of the autopilot",
    "file_check/checking.py": "a file's name is cut off, for people",
    "flight/settings/profile.py": "a parameter file's notation",
    "flight/settings/parameter_files.py": "a parameter file's notation",
    "demo/own_camera.py": "a file's name is not said twice, for people",
}


def spoken(node):
    """The name of an expression that is a text for people, "" where it is none."""
    name = getattr(node, "attr", getattr(node, "id", "")).lstrip("_")
    return name if _TEXTS.fullmatch(name) else ""


def literal(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, (str, bytes)) and node.value


def sought(node):
    """Whether it is a text, or the name of a constant."""
    name = node.id if isinstance(node, ast.Name) else ""
    return literal(node) or re.fullmatch(r"_?[A-Z][A-Z_]+", name)


def read_for_its_words(node):
    """Whether a node looks for words in a text, or compares it with some."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        name, does = spoken(node.func.value), node.func.attr
        takes_apart = does in ("partition", "split") and not re.fullmatch(_READ, name)
        asks = does in ("startswith", "endswith", "find", "index") or takes_apart
        return bool(name and asks)
    if not isinstance(node, ast.Compare):
        return False
    for a, op, b in zip([node.left, *node.comparators], node.ops, node.comparators):
        if isinstance(op, (ast.In, ast.NotIn)) and sought(a) and spoken(b):
            return True
        if isinstance(op, (ast.Eq, ast.NotEq)):
            if (literal(a) and spoken(b)) or (literal(b) and spoken(a)):
                return True
    return False


@pytest.mark.parametrize("package", ["fcsv_control", "fcsv_console", "fcsv_sim", "fcsv_tracking"])
def test_no_text_for_people_steers_code(package):
    """What a program has to know stands in a field or an enumeration beside the text."""
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in modules(package)
        if not any(str(path).endswith(f"{package}/{name}") for name in _FOREIGN_WORDS)
        for node in ast.walk(ast.parse(path.read_text()))
        if read_for_its_words(node)
    ]
    assert not found, f"{found}: give the message or dataclass a field"


@pytest.mark.parametrize(
    "code, steers",
    [
        ('reply.text.startswith("refused")', True),
        ('"OUT" in row.words', True),
        ('any("abort" in t.text for t in found)', True),
        ('told == "nothing"', True),
        ("_BY_HAND in refused", True),
        ('a.sender.split("-")[0]', True),
        ('text.split(",")', False),
        ('name.startswith("uav")', False),
        ('phase == "LAND"', False),
        ('told.phase == "LAND"', False),
        ("words != self._words", False),
        ('"; ".join(reasons)', False),
    ],
)
def test_what_reads_a_text_for_its_words_is_found(code, steers):
    assert steers == any(read_for_its_words(n) for n in ast.walk(ast.parse(code)))


#: What ages and charge are called where they are compared with a bound.
_AGES = re.compile(r"_*(\w+_)?(age_s|silent_s|battery|battery_share)")
#: Where a number next to one is no bound of a condition.
_NO_BOUNDS = {
    "fcsv_console/model/hearing.py": "in which unit an age is said",
    "fcsv_control/agent/duplicate_agents.py": "which of two agents is older",
    "fcsv_control/flight/mavlink/identity.py": "who speaks on the line, as MAVROS has it",
    "fcsv_control/flight/mavros_watch.py": "which values a parameter takes",
    "fcsv_control/flight/state.py": "MAVLink's own mark of what is not known",
    "fcsv_control/guardian/room.py": "how calm the radio is, for a way",
    "fcsv_control/mission/memory.py": "of which flight a file is",
    "fcsv_control/ros/tello/tello_video.py": "which values a parameter takes",
}


def numbers_of(tree):
    """The constants that a module's top gives a number."""
    return {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)
        for target in node.targets
        if isinstance(target, ast.Name)
    }


def judged_by_own_numbers(tree):
    """Lines that compare an age, a silence or a battery with a number of their own."""
    own = numbers_of(tree)
    for node in (n for n in ast.walk(tree) if isinstance(n, ast.Compare)):
        sides = [node.left, *node.comparators]
        named = [getattr(s, "attr", getattr(s, "id", "")) for s in sides]
        since = [getattr(s.right, "attr", "") for s in sides if isinstance(s, ast.BinOp)]
        number = any(
            isinstance(getattr(s, "value", None), (int, float)) or getattr(s, "id", "") in own
            for s in sides
        )
        if number and (any(map(_AGES.fullmatch, named)) or "heard_s" in since):
            yield node.lineno


@pytest.mark.parametrize("package", ["fcsv_control", "fcsv_console"])
def test_batteries_and_ages_are_judged_by_the_one_table_of_thresholds(package):
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in modules(package)
        if not any(str(path).endswith(name) for name in _NO_BOUNDS)
        for line in judged_by_own_numbers(ast.parse(path.read_text()))
    ]
    assert not found, f"{found}: fcsv_geometry.vehicles.thresholds, fcsv_control.conditions"


@pytest.mark.parametrize(
    "code, own",
    [
        ("_OLD_S = 3.5\nview.state_age_s <= _OLD_S", True),
        ("report.battery_share < 0.2", True),
        ("_OLD_S = 3.0\nnow_s - seen.heard_s > _OLD_S", True),
        ("air.silent_s > rules.link_warn_s", False),
        ("view.pose_age_s > at.POSE_AGE_S.mission.red", False),
        ("share < 1.0", False),
    ],
)
def test_what_is_judged_by_an_own_number_is_found(code, own):
    assert own == bool(list(judged_by_own_numbers(ast.parse(code))))


def test_flight_modes_are_named_by_their_enumeration():
    """GUIDED and LAND are phases of a mission, too; a simulated camera or robot has none."""
    own = ROOT / "src/fcsv_geometry/src/fcsv_geometry/vehicles/modes.py"
    names = {"STABILIZE", "ALT_HOLD", "LOITER", "BRAKE", "POSHOLD", "RTL", "SMART_RTL"}
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path, node in definitions(ast.Constant)
        if path != own and node.value in names
    ]
    assert not found, f"{found}: fcsv_geometry.vehicles.modes.Mode"


def test_lines_are_short_and_the_formatter_decides():
    """Texts may be longer than 100 characters, one line in a hundred; the linter stops at 120."""
    code = [p for p in tracked() if p.suffix == ".py"]
    lines = [line for p in code for line in p.read_text().splitlines()]
    assert sum(len(line) > 100 for line in lines) < 0.01 * len(lines)
    assert sum(line.endswith("# fmt: " + "skip") for line in lines) < 60
