# SPDX-License-Identifier: Apache-2.0
"""The whole test run: plain tests on all cores, tests of nodes and in slow motion two at a time,
flights alone; one count of all.

    tools/run_tests.py [pytest's arguments]

Exit status 0 where nothing failed; 5 where a tier, or with arguments all, collected none; 4 at once
where a file or test that is named is not there. More: docs/design/testing.md.
"""

import difflib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# a worker takes up to 2 GB
SIDE_BY_SIDE = ["--numprocesses=logical", "--maxprocesses=8", "--dist=loadgroup"]
TWO = ["--numprocesses=2", "--dist=loadgroup"]  # nodes wait for one another more than they work
TIERS = {"plain": SIDE_BY_SIDE, "nodes": TWO, "slowed": TWO, "flights": [], "alone": []}
SLOWEST = ["--durations=25", "--durations-min=3"]
# pytest's exit statuses; above FAILED and below NOTHING it could not run
PASSED, FAILED, NOTHING = 0, 1, 5
MISTYPED = 4  # pytest's for a wrong argument
# pytest's options whose value is a word of its own
WITH_VALUE = {
    "-k",
    "-m",
    "-n",
    "-p",
    "-c",
    "-o",
    "-r",
    "-W",
    "--deselect",
    "--ignore",
    "--junitxml",
    "--rootdir",
    "--tb",
    "--durations",
    "--maxfail",
    "--basetemp",
    "--dist",
    "--numprocesses",
    "--maxprocesses",
    "--color",
}
SHOWN = ("passed", "failed", "error", "skipped", "xfailed", "xpassed")


def mistyped(arguments, root: Path) -> str:
    """What is wrong with the files and tests that pytest's ``arguments`` name, with the nearest
    name; "" if nothing.

    Pytest says it too, but after it started workers for a tier, and once for each.
    """
    named = [
        word
        for before, word in zip(["", *arguments], arguments)
        if before not in WITH_VALUE and word[:1] != "-"
    ]
    for word in named:
        name, *parts = word.split("[")[0].split("::")
        path = root / name
        if not path.exists():
            return f"no file '{name}'{_nearest(name, _test_files(root))}"
        text = path.read_text() if path.is_file() else ""
        for part in parts:
            if not re.search(
                rf"^ *(?:(?:async )?def|class) {re.escape(part)}\b|^{re.escape(part)} =", text, re.M
            ):
                known = re.findall(r"^ *(?:def|class) (test_\w+|Test\w+)", text, re.M)
                return f"{name} has no test '{part}'{_nearest(part, known)}"
    return ""


def _test_files(root: Path):
    return [str(path.relative_to(root)) for path in sorted(root.glob("tests/**/test_*.py"))]


def _nearest(name: str, known) -> str:
    """What was likely meant, in words: by its last part first, so that a wrong folder is found
    too."""
    tails = {Path(k).name: k for k in known}
    near = (
        difflib.get_close_matches(word, tails, n=1) for word in (Path(name).name, Path(name).stem)
    )
    found = next(filter(None, near), None)
    return f"; did you mean '{tails[found[0]]}'?" if found else ""


def pytest_status(arguments) -> int:
    """Run pytest to its end. Ctrl-C reaches it from the terminal; whoever ends this process ends it
    like Ctrl-C."""
    # hundreds of processes import the same modules: they are compiled once
    env = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    child = subprocess.Popen([sys.executable, "-m", "pytest", *arguments], cwd=ROOT, env=env)
    signal.signal(signal.SIGINT, lambda *_: None)
    signal.signal(signal.SIGTERM, lambda *_: child.send_signal(signal.SIGINT))
    return child.wait()


def run_tier(name: str, arguments, folder: Path):
    """(exit status, counts) of one tier; the user's arguments come last and so overrule."""
    counts = folder / f"{name}.json"
    status = pytest_status(
        [f"--tier={name}", f"--counts={counts}", *TIERS[name], *SLOWEST, *arguments]
    )
    return status, json.loads(counts.read_text()) if counts.exists() else {}


def overall(statuses, explicit: bool) -> int:
    """One exit status. With arguments of the user's a tier may be empty, without them none may."""
    serious = [s for s in statuses.values() if s not in (PASSED, FAILED, NOTHING)]
    if serious:
        return serious[0]
    if FAILED in statuses.values():
        return FAILED
    empty = [name for name, status in statuses.items() if status == NOTHING]
    return NOTHING if empty and (not explicit or len(empty) == len(statuses)) else PASSED


def main(arguments) -> int:
    wrong = mistyped(arguments, ROOT)
    if wrong:
        print(f"test: {wrong}", file=sys.stderr)
        return MISTYPED
    began_s = time.monotonic()
    statuses, counts = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        for name in TIERS:
            print(f"== tests of the tier '{name}'", flush=True)
            statuses[name], counts[name] = run_tier(name, arguments, Path(folder))
            stops = FAILED if {"-x", "--exitfirst"} & {*arguments} else None
            if statuses[name] not in {PASSED, FAILED, NOTHING} - {stops}:
                break
    status = overall(statuses, bool(arguments))
    for name in statuses:
        if statuses[name] == NOTHING and not arguments:
            print(f"the tier '{name}' collected no test")
    for tier in counts.values():
        print(*tier.get("names", ()), sep="\n", end="\n" if tier.get("names") else "")
    total = {name: sum(tier.get(name, 0) for tier in counts.values()) for name in SHOWN}
    said = ", ".join(
        f"{n} {name}" for name, n in total.items() if n or name in ("passed", "failed", "skipped")
    )
    print(
        f"{sum(total.values())} tests: {said}, in {(time.monotonic() - began_s) / 60:.1f} min",
        flush=True,
    )
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
