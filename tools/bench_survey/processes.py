# SPDX-License-Identifier: Apache-2.0
"""Surveys as processes of their own: their time and memory, and what is left of them when they are
killed."""

import hashlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Iterable, List, Tuple

import numpy as np
import psutil

from fcsv_stereo.survey.survey import FILES

_NOTES = ("views/*.json", "edges/*.json", "placed/*.zip", "points/*.zip", "tiles/*.zip")
_LONGER_S = 1.0  # after the share of work that it is killed at, a run lives so long at most
_HANGS = 10.0  # times what a whole run takes: so long a run has come no further
_COMMAND = "import sys; from fcsv_stereo.survey.command import main; sys.exit(main())"


def survey_process(folders: List[Path], out: Path, *options: str) -> subprocess.Popen:
    """A survey as a process of its own, which leads its group."""
    words = [sys.executable, "-c", _COMMAND, *map(str, folders), "-o", str(out), *options]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen(words, start_new_session=True, **quiet)


def content_of(out: Path) -> Dict[str, str]:
    """Checksums of a site's files, its tiles' and points' among them."""
    whole = [out / n for n in FILES if (out / n).is_file()]
    zips = [p for n in ("placed", "points", "tiles") for p in out.glob(f"{n}/*.zip")]
    texts = {p: p.read_bytes() for p in [*whole, *out.glob("tiles/*.laz")]}
    texts.update({p: _members(p) for p in zips})
    return {str(p.relative_to(out)): hashlib.sha256(t).hexdigest() for p, t in texts.items()}


def _members(path: Path) -> bytes:
    """Checksums of what a zip file holds, whenever it was written."""
    with zipfile.ZipFile(path) as file:
        return repr(sorted((i.filename, i.CRC) for i in file.infolist())).encode()


def written(out: Path) -> Dict[Path, int]:
    """When (ns) each note of a map, edge, placed view, view's points and tile was written; they are written when
    all else is."""
    found = (p for folder in _NOTES for p in out.glob(folder))
    return {p: p.stat().st_mtime_ns for p in found}


def _counts(there: Iterable[Path]) -> List[int]:
    """How many maps, edges, placed views, views' points and tiles there are."""
    return [sum(p.match(n) for p in there) for n in _NOTES]


def _wait_for(
    process: subprocess.Popen, out: Path, share: float, whole: List[int], most_s: float
) -> None:
    """Waits until a survey has made this share of its ``whole``, maps, edges, placed views,
    points and tiles each a fifth of it, or ends. Raises SystemExit where it does not get there."""
    until = time.monotonic() + most_s
    while process.poll() is None and np.mean(np.divide(_counts(written(out)), whole)) < share:
        if time.monotonic() > until:
            os.killpg(process.pid, signal.SIGKILL)
            raise SystemExit(f"a survey came no further than {_counts(written(out))} of {whole}")
        time.sleep(0.05)


def kills(folders: List[Path], out: Path, count: int, seed: int) -> Dict[str, str]:
    """Seconds without and with one and two processes, whether all write the same, and what a run
    writes that was killed at random moments: one in each of ``count`` equal shares of its work."""
    took, contents, random = {}, {}, np.random.default_rng(seed)
    for name in ("0", "1", "2", "killed"):
        shutil.rmtree(out / name, ignore_errors=True)
    for workers in ("0", "1", "2"):
        started = time.perf_counter()
        if survey_process(folders, out / workers, "--workers", workers).wait() != 0:
            raise SystemExit(f"--workers {workers} ended with an error")
        took[workers] = time.perf_counter() - started
        contents[workers] = content_of(out / workers)
    made, lost, kept, whole = [], 0, {}, _counts(written(out / "2"))
    for share in (np.arange(count) + random.random(count)) / count:
        process = survey_process(folders, out / "killed", "--workers", "2")
        _wait_for(process, out / "killed", share, whole, _HANGS * took["2"])
        try:
            process.wait(float(random.uniform(0.0, _LONGER_S)))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            lost += 1
        there = written(out / "killed")
        made.append("+".join(map(str, _counts(there))))
        kept = {**there, **kept}  # by the first time that it was there
    if survey_process(folders, out / "killed", "--workers", "2").wait() != 0:
        raise SystemExit("what was killed did not go on")
    contents["killed"] = content_of(out / "killed")
    now = written(out / "killed")
    again = [path.name for path, stamp in kept.items() if now.get(path) != stamp]
    names = {n for of in contents.values() for n in of}
    differ = {
        name: sorted(n for n in names if contents["0"].get(n) != of.get(n)) or "nothing"
        for name, of in contents.items()
    }
    return {
        "seconds in a plain loop, by one process, by two": ", ".join(
            f"{took[w]:.0f}" for w in ("0", "1", "2")
        ),
        "two processes against one": f"{took['1'] / took['2']:.2f}",
        "differs from the plain loop: one, two processes": f"{differ['1']}, {differ['2']}",
        f"killed {lost} times, maps + edges + placed + points + tiles that were there then": ", ".join(
            made
        ),
        "of these computed again": ", ".join(again) or "none",
        "differs from the plain loop: after the kills": str(differ["killed"]),
    }


@dataclass(frozen=True)
class Cost:
    """Of a whole survey: seconds of the clock and of the processors; most memory (GB) that one
    worker had at a time, and the survey's own process."""

    wall_s: float
    cpu_s: float
    memory_gb: float
    own_gb: float


def cost(folders: List[Path], out: Path, workers: int) -> Cost:
    """Of a survey from nothing."""
    shutil.rmtree(out, ignore_errors=True)
    started, before = time.perf_counter(), _children_s()
    process = survey_process(folders, out, "--workers", str(workers))
    most = np.zeros(2)
    while process.poll() is None:
        most = np.maximum(most, _memory(process.pid))
        time.sleep(0.2)
    if process.returncode:
        raise SystemExit(f"a survey of {len(folders)} views ended with status {process.returncode}")
    return Cost(time.perf_counter() - started, _children_s() - before, *(most / 1e9))


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _memory(pid: int) -> Tuple[int, int]:
    """Bytes of the largest worker, and of the survey's own process."""
    try:
        survey = psutil.Process(pid)
        return max([_bytes(p) for p in survey.children(recursive=True)], default=0), _bytes(survey)
    except psutil.Error:
        return 0, 0


def _bytes(process: psutil.Process) -> int:
    try:
        return process.memory_info().rss
    except psutil.Error:
        return 0  # it has ended


def growth(folders: List[Path], few: int, out: Path) -> Dict[str, str]:
    """What a few views and all cost; and one worker against two with the few."""
    some = {w: cost(folders[:few], out / "few", w) for w in (1, 2)}
    every = cost(folders, out / "all", 2)
    named = f"{few} views, {len(folders)} views"
    share = (every.cpu_s / len(folders)) / (some[2].cpu_s / few)
    return {
        f"seconds of the processor with two workers: {named}": f"{some[2].cpu_s:.0f}, {every.cpu_s:.0f}",
        "a view of all against a view of the few": f"{share:.2f}",
        f"seconds of the clock with two workers: {named}": f"{some[2].wall_s:.0f}, {every.wall_s:.0f}",
        f"seconds of the clock with one worker, {few} views": f"{some[1].wall_s:.0f}",
        "two workers against one": f"{some[1].wall_s / some[2].wall_s:.2f}",
        f"memory of the largest worker (GB): {named}": f"{some[2].memory_gb:.2f}, {every.memory_gb:.2f}",
        f"memory of the survey's own process (GB): {named}": f"{some[2].own_gb:.2f}, {every.own_gb:.2f}",
    }
