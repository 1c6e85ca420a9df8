# SPDX-License-Identifier: Apache-2.0
"""What each tuned number of ``joint`` changes: by 30 % up and down, on the bench's scenes at half
size.

    tools/run tuned-numbers FOLDER                 goes on where it was stopped
    tools/run tuned-numbers FOLDER --groups 9      groups first, then halves of those that matter
    tools/run tuned-numbers FOLDER --stage Sgm     one stage's numbers
    tools/run tuned-numbers FOLDER --show          the table of what is there

FOLDER keeps the drawn scenes, the compiled kernels and a line of JSON per variation
(``varied.jsonl``); all of it takes about five hours of one core. Kernels freeze their numbers when
they are compiled, so every variation runs in a process of its own, with the kernels that its stage
reaches compiled anew.

Groups take a fifth of that time. The numbers of a group change at once, each up or down by chance,
then each the other way. A group that changes nothing beyond the scatter is done with, another is
halved (sequential bifurcation: Bettonvil and Kleijnen 1997). Two numbers whose changes cancel each
other in both runs are missed.

A change counts where its mean over the scenes is larger than twice the standard error of the same
mean between two draws of the poses' noise.
"""

import argparse
import ast
import json
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
import zlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple

import numpy as np

from bench.scenes import LISTS, SCENES, shoot
from fcsv_stereo.joint import tuning
from fcsv_stereo.joint.tuning import STAGES, Tuned
from harness import show

SIZE = (320, 240)
#: Of the number's value, down and up.
FACTORS = (0.7, 1.3)
LIST = "H 2, 4, 6, 8 m"
#: In points (per cent) of a scene's pixels; after them the map's seconds of the processor.
FIGURES = ("within 10 %", "wrong of answered", "within 2 sigma")
_BETWEEN = "; "  # numbers of a key
_PACKAGE = Path(tuning.__file__).resolve().parents[3]


@dataclass(frozen=True)
class Variation:
    """Numbers of a stage, by name, with the values that take their places."""

    stage: str
    values: Tuple[Tuple[str, Any], ...]

    @property
    def key(self) -> str:
        return f"{self.stage}." + _BETWEEN.join(f"{n}={v}" for n, v in self.values)


class Group(NamedTuple):
    """Numbers of a stage that are varied at once."""

    stage: str
    numbers: Tuple[str, ...]

    def both(self) -> List[Variation]:
        """Each number down or up by chance (always the same), then each the other way."""
        stage = next(s for s in STAGES if type(s).__name__ == self.stage)
        pairs = [varied(getattr(stage, n)) for n in self.numbers]
        random = np.random.default_rng(zlib.crc32(repr(self).encode()))
        first = random.integers(0, 2, len(pairs)) if len(pairs) > 1 else [0]
        return [
            Variation(
                self.stage,
                tuple((n, p[(at + turn) % len(p)]) for n, p, at in zip(self.numbers, pairs, first)),
            )
            for turn in (0, 1)
        ]

    def cut(self, parts: int) -> List["Group"]:
        """Groups of neighbours that are alike in size."""
        ends = [round(len(self.numbers) * i / parts) for i in range(parts + 1)]
        return [Group(self.stage, self.numbers[a:b]) for a, b in zip(ends, ends[1:])]


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Varies what is not yet in the folder; prints a line a variation, at the end the table."""
    parser = argparse.ArgumentParser(prog="tuned-numbers", description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", type=Path, help="keeps scenes, kernels and results")
    stages = [type(stage).__name__ for stage in STAGES]
    parser.add_argument("--stage", choices=stages, help="only this stage's numbers")
    parser.add_argument("--groups", type=int, metavar="N", help="vary N numbers at once, at most")
    parser.add_argument("--show", action="store_true", help="only the table of what is there")
    args = parser.parse_args(argv)
    if args.show and not _kept(args.folder).exists():
        parser.error(f"{args.folder} holds no results; leave --show out to make them")
    wanted = [g for g in groups(args.groups or 1) if args.stage in (None, g.stage)]
    while wanted and not args.show:
        _vary(args.folder, [v for g in wanted for v in g.both()])
        open_ = [g for g in wanted if _verdict(_read(args.folder), g) in ("matters", "fails")]
        wanted = [half for g in open_ if len(g.numbers) > 1 for half in g.cut(2)]
    _show(_read(args.folder))
    return 0


def groups(most: int) -> Iterator[Group]:
    """Every number of every stage, ``most`` of one stage in a group at most."""
    for stage in STAGES:
        names = tuple(f.name for f in fields(stage) if varied(getattr(stage, f.name)))
        yield from Group(type(stage).__name__, names).cut(-(-len(names) // most))


def varied(value: Any) -> List[Any]:
    """The value by 30 % less and more; whole numbers stay whole and change by one at least, tuples
    by all their members at once, what is true or false turns over; zero has no shares.

    >>> varied(10), varied(1), varied(0.5), varied((4, 2.0)), varied(True)
    ([7, 13], [0, 2], [0.35, 0.65], [[3, 1.4], [5, 2.6]], [False])
    """
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, tuple):
        down, up = zip(*(varied(v) for v in value))
        return [list(down), list(up)]
    if isinstance(value, int):
        return [
            min(value - 1, round(value * FACTORS[0])),
            max(value + 1, round(value * FACTORS[1])),
        ]
    return [float(f"{value * factor:.6g}") for factor in FACTORS] if value else []


# ---- in the parent


def _vary(folder: Path, wanted: Sequence[Variation]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    _draw(folder)
    kept = _kept(folder)
    for label, one in (("as it is", {"noise": 0}), ("drawn again", {"noise": 1})):
        if label not in _read(folder):
            print(f"{label} ...", flush=True)
            _keep(kept, label, _child(folder, folder / "kernels", one))
    done = _read(folder)
    for at, variation in enumerate(wanted, 1):
        if variation.key in done:
            continue
        with tempfile.TemporaryDirectory(dir=str(folder)) as kernels:
            copied = Path(kernels) / "kernels"
            shutil.copytree(folder / "kernels", copied, copy_function=os.link)
            _forget(copied, reached(variation.stage))
            values = {"stage": variation.stage, "values": dict(variation.values)}
            result = _child(folder, copied, {"noise": 0, **values})
        _keep(kept, variation.key, result)
        print(f"{at} of {len(wanted)}  {variation.key}  {_words(done, result)}", flush=True)


def _draw(folder: Path) -> None:
    for name in SCENES:
        path = folder / f"{name}.pickle"
        if not path.exists():
            partly = path.with_suffix(".partly")
            partly.write_bytes(pickle.dumps(shoot(name, LISTS[LIST], SIZE)))
            partly.rename(path)


def _child(folder: Path, kernels: Path, one: Dict[str, Any]) -> Dict[str, Any]:
    """Figures by scene of one variation, or ``{"error": ...}`` where the process failed."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(kernels)}
    command = [sys.executable, "-m", "bench.one_variation", str(folder), json.dumps(one)]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True)
    if ended.returncode:
        return {"error": (ended.stderr.strip() or "no word").splitlines()[-1]}
    return json.loads(ended.stdout.splitlines()[-1])


def reached(stage: str) -> Set[str]:
    """Names of the modules (last part) whose kernels hold the stage's numbers: those that import
    it, and those that import them."""
    name = next(n for n, s in _stage_names().items() if type(s).__name__ == stage)
    imports = {_module(p): _imported(p) for p in sorted(_PACKAGE.glob("fcsv_stereo/**/*.py"))}
    found = {m for m, names in imports.items() if f"fcsv_stereo.joint.tuning.{name}" in names}
    while True:
        more = {
            m
            for m, names in imports.items()
            if any(n in found or n.rsplit(".", 1)[0] in found for n in names)
        } - found
        if not more:
            return {m.rsplit(".", 1)[1] for m in found}
        found |= more


def _stage_names() -> Dict[str, Tuned]:
    return {n: getattr(tuning, n) for n in tuning.__all__ if getattr(tuning, n) in STAGES}


def _module(path: Path) -> str:
    return ".".join(path.relative_to(_PACKAGE).with_suffix("").parts)


def _imported(path: Path) -> Set[str]:
    """``module.name`` of all that a file imports from somewhere."""
    return {
        f"{node.module}.{alias.name}"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }


def _forget(kernels: Path, modules: Set[str]) -> None:
    """Removes the compiled kernels of these modules; numba names a file ``module.kernel-line...``"""
    for path in kernels.rglob("*.nb?"):
        if path.name.split(".", 1)[0] in modules:
            path.unlink()


# ---- results


class Change(NamedTuple):
    """Means over scenes of the figures' changes (points), and the seconds' ratio."""

    points: Sequence[float]
    time: float


def change(base: Dict[str, List[float]], other: Dict[str, List[float]]) -> Change:
    """What a variation changes, scene by scene, in the mean."""
    a, b = (np.array([rows[str(n)] for n in SCENES]) for rows in (base, other))
    points = (b - a)[:, : len(FIGURES)].mean(axis=0)
    return Change(points.tolist(), float(np.median(b[:, -1] / a[:, -1])))


def scatter(base: Dict[str, List[float]], again: Dict[str, List[float]]) -> np.ndarray:
    """Standard error of each figure's mean over the scenes, from two draws of the poses' noise."""
    a, b = (np.array([rows[str(n)] for n in SCENES]) for rows in (base, again))
    return (b - a)[:, : len(FIGURES)].std(axis=0, ddof=1) / np.sqrt(len(SCENES))


def verdict(changes: Sequence[Change], error: np.ndarray) -> str:
    """*not reached* where nothing changed at all, *same* within twice the error, else *matters*."""
    points = np.abs([c.points for c in changes])
    if not points.any():
        return "not reached"
    return "same" if (points <= 2.0 * error).all() else "matters"


def _words(done: Dict[str, Any], result: Dict[str, Any]) -> str:
    if "error" in result:
        return f"failed: {result['error']}"
    c = change(done["as it is"], result)
    said = ", ".join(f"{name} {p:+.2f}" for name, p in zip(FIGURES, c.points))
    return f"{said}, time x {c.time:.2f}"


def _verdict(done: Dict[str, Any], group: Group) -> str:
    """``verdict`` of a group's two runs; *fails* where one came to no end, *open* where one is
    missing."""
    results = [done.get(v.key) for v in group.both()]
    if None in results:
        return "open"
    if any("error" in r for r in results):
        return "fails"
    base = done["as it is"]
    return verdict([change(base, r) for r in results], scatter(base, done["drawn again"]))


def measured(done: Dict[str, Any]) -> Dict[Tuple[str, str], Tuple[str, Group]]:
    """Verdict of each number (stage, name), and the group that it comes from.

    A group that changes nothing speaks for all of its numbers, one that matters for its number
    where it has only one; else the number stays *open*, in the smallest of its groups.
    """
    known = {(type(s).__name__, f.name): getattr(s, f.name) for s in STAGES for f in fields(s)}
    found: Dict[Tuple[str, str], Tuple[str, Group]] = {}
    seen = {}
    for key in done:
        stage, point, values = key.partition(".")
        names = tuple(v.partition("=")[0] for v in values.split(_BETWEEN)) if point else ()
        if names and all((stage, n) in known for n in names):
            seen[Group(stage, names)] = None
    for group in sorted(seen, key=lambda g: -len(g.numbers)):
        word = _verdict(done, group)
        for number in group.numbers if word != "open" else ():
            alone = len(group.numbers) == 1 or word in ("same", "not reached")
            if alone or (group.stage, number) not in found:
                found[group.stage, number] = (word if alone else "open", group)
    return found


def _show(done: Dict[str, Any]) -> None:
    base, error = done["as it is"], scatter(done["as it is"], done["drawn again"])
    print("\ntwice the scatter: " + ", ".join(f"{n} {2 * e:.2f}" for n, e in zip(FIGURES, error)))
    rows, counts = [], {}
    found = measured(done)
    for stage in STAGES:
        for f in fields(stage):
            word, group = found.get((type(stage).__name__, f.name), ("", None))
            if group is None:
                continue
            counts[word] = counts.get(word, 0) + 1
            results = [done[v.key] for v in group.both()]
            row = (group.stage, f.name, getattr(stage, f.name), word, len(group.numbers))
            if any("error" in r for r in results):
                rows.append((*row, *["fails"] * len(FIGURES)))
                continue
            columns = zip(*(change(base, r).points for r in results))
            rows.append((*row, *(" / ".join(f"{p:+.2f}" for p in c) for c in columns)))
    show(("stage", "number", "value", "by 30 %", "varied at once", *FIGURES), rows)
    print("\n" + ", ".join(f"{n} {word}" for word, n in sorted(counts.items())))


def _kept(folder: Path) -> Path:
    return folder / "varied.jsonl"


def _keep(path: Path, key: str, result: Dict[str, Any]) -> None:
    with path.open("a") as f:
        f.write(json.dumps({"key": key, "result": result}) + "\n")


def _read(folder: Path) -> Dict[str, Any]:
    """What is kept; a line that a stop cut off is left out."""
    done = {}
    for text in _kept(folder).read_text().splitlines() if _kept(folder).exists() else ():
        try:
            entry = json.loads(text)
        except json.JSONDecodeError:
            continue
        done[entry["key"]] = entry["result"]
    return done


if __name__ == "__main__":
    sys.exit(main())
