# SPDX-License-Identifier: Apache-2.0
"""A simulation that takes the time it needs: where the machine is too slow for real time, time itself passes slowly.

Everything simulated, autopilots, cameras, nodes and masters, then runs at a fraction of real time, all by one clock,
and none is starved. A library that is preloaded (slow_motion/slow_motion.c) slows the clocks and waits of whole
programs by a page of memory that this module writes; programs without it, such as the map's, are in real time.
"""

import argparse
import mmap
import os
import struct
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Tuple

from fcsv_geometry.errors import FcsvError

AUTO = "auto"
LEAST_RATE = 0.5
_LIBRARY = "libfcsv_slow_motion.so"
_PRELOAD, _PAGE = "LD_PRELOAD", "FCSV_SLOW_MOTION"
_INDEX, _PART = struct.Struct("=I4x"), struct.Struct("=qqd")  # as struct page in slow_motion.c
_PERIOD_S = 0.5
_BUSY = 0.85  # of the processors: what more is wanted, waits
_MOST_DOWN, _MOST_UP = 0.9, 1.05  # in a period: waits that began at another rate end nearly when they should


class SlowMotionError(FcsvError):
    """A rate that cannot be, or a workspace that is not built; the message says which."""


class Page:
    """The clock that programs share: since when (s, CLOCK_MONOTONIC), how far it lagged then (s), and its rate."""

    def __init__(self, path, create: bool = False):
        if create:
            Path(path).write_bytes(_INDEX.pack(0) + 2 * _PART.pack(0, 0, 1.0))
        with open(path, "r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)

    def read(self) -> Tuple[float, float, float]:
        used = _INDEX.unpack_from(self._map)[0]
        since_ns, lag_ns, rate = _PART.unpack_from(self._map, _INDEX.size + used * _PART.size)
        return 1e-9 * since_ns, 1e-9 * lag_ns, rate

    def lag_s(self, now_s: float) -> float:
        """How far the slow clocks lag behind at a moment of the real CLOCK_MONOTONIC."""
        since_s, lag_s, rate = self.read()
        return lag_s + (now_s - since_s) * (1.0 - rate)

    def now_s(self) -> float:
        """The slow time.monotonic(), for a process in real time."""
        now_s = time.monotonic()
        return now_s - self.lag_s(now_s)

    def set_rate(self, rate: float, now_s: float) -> None:
        """From ``now_s`` on; called in real time."""
        part = _PART.pack(int(1e9 * now_s), int(1e9 * self.lag_s(now_s)), rate)
        free = 1 - _INDEX.unpack_from(self._map)[0]
        at = _INDEX.size + free * _PART.size
        self._map[at : at + _PART.size] = part
        self._map[:4] = struct.pack("=I", free)


def parse_rate(word: str) -> Optional[float]:
    """None for "auto". Raises SlowMotionError."""
    if word == AUTO:
        return None
    try:
        rate = float(word)
    except ValueError:
        rate = float("nan")
    if not LEAST_RATE <= rate <= 1.0:
        raise SlowMotionError(f"speed {word}: give {AUTO} or a share of real time, {LEAST_RATE:g} to 1")
    return rate


@contextmanager
def slow_motion(rate: Optional[float] = None) -> Iterator[Page]:
    """What this process starts inside runs at ``rate``, or as fast as the machine has room for; it itself does not.

    Raises SlowMotionError.
    """
    changes = _changes(rate)
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield Page(changes[_PAGE])
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
        Path(changes[_PAGE]).unlink()


def begin_again_in(rate: Optional[float]) -> None:
    """This program from its beginning in slow motion, in the same process; nothing where it already is or needs not be.

    Raises SlowMotionError.
    """
    if rate != 1.0 and _PAGE not in os.environ:
        os.environ.update(_changes(rate))
        os.execv(sys.executable, [sys.executable, *sys.argv])


def both_clocks() -> Tuple[float, float]:
    """This process's time.monotonic(), which may be slow, and the real one (s)."""
    now_s = time.monotonic()
    if _PAGE not in os.environ:
        return now_s, now_s
    since_s, lag_s, rate = Page(os.environ[_PAGE]).read()
    return now_s, (now_s + lag_s - since_s * (1.0 - rate)) / rate  # now = real - (lag + (real - since)(1 - rate))


def share_of_real_time(since: Tuple[float, float]) -> float:
    """How fast time passed for this process since a moment of ``both_clocks``."""
    (slow_s, real_s), now = since, both_clocks()
    return (now[0] - slow_s) / (now[1] - real_s)


def shared_time(env: Dict[str, str]) -> Dict[str, str]:
    """Of an environment what makes a program share its time; empty in real time."""
    return {name: env[name] for name in (_PRELOAD, _PAGE) if _PAGE in env}


def in_real_time(env: Dict[str, str]) -> Dict[str, str]:
    """An environment whose programs are not slowed: those that measure how long they take."""
    return {name: value for name, value in env.items() if name not in shared_time(env)}


def _changes(rate: Optional[float]) -> Dict[str, str]:
    """Of the environment; a page that begins now, and who keeps its rate until this process ends."""
    library = _library()
    handle, path = tempfile.mkstemp(prefix="fcsv-slow-motion-")
    os.close(handle)
    Page(path, create=True).set_rate(1.0 if rate is None else rate, time.monotonic())
    keeper = [sys.executable, "-m", "fcsv_sim.slow_motion", path, str(os.getpid()), *([] if rate else [AUTO])]
    subprocess.Popen(keeper, start_new_session=True)
    return {_PRELOAD: str(library), _PAGE: path}


def _library() -> Path:
    for prefix in os.environ.get("CMAKE_PREFIX_PATH", "").split(":"):
        found = Path(prefix) / "lib" / _LIBRARY
        if found.is_file():
            return found
    raise SlowMotionError(
        f"{_LIBRARY} is in no workspace of CMAKE_PREFIX_PATH: build with 'make setup', or fly with SPEED=1"
    )


def next_rate(rate: float, busy: float) -> float:
    """What keeps the processors (``busy``: 0 to 1) at their share of work, as work goes with the rate."""
    change = min(max(_BUSY / max(busy, 1e-3), _MOST_DOWN), _MOST_UP)
    return min(max(rate * change, LEAST_RATE), 1.0)


def _busy_and_all() -> Tuple[int, int]:
    """Of all processors so far; what a hypervisor took away is not idle."""
    times: List[int] = [int(n) for n in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]
    return sum(times) - times[3] - times[4], sum(times)


def main() -> int:
    """The keeper of a page, in real time: adapts its rate where asked, and removes it once its process is no more."""
    parser = argparse.ArgumentParser(prog="slow_motion", description=main.__doc__)
    parser.add_argument("page")
    parser.add_argument("pid", type=int)
    parser.add_argument("rate", nargs="?", choices=[AUTO])
    args = parser.parse_args()
    try:
        page, last = Page(args.page), _busy_and_all()
    except FileNotFoundError:
        return 0  # it was over before this began
    while os.getppid() == args.pid and os.path.exists(args.page):
        time.sleep(_PERIOD_S)
        now = _busy_and_all()
        if args.rate == AUTO and now[1] > last[1]:
            page.set_rate(next_rate(page.read()[2], (now[0] - last[0]) / (now[1] - last[1])), time.monotonic())
        last = now
    Path(args.page).unlink(missing_ok=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
