# SPDX-License-Identifier: Apache-2.0
"""A simulation that takes the time it needs: where the machine is too slow for real time, time
itself passes slowly.

Everything simulated, autopilots, cameras, nodes and masters, then runs at a fraction of real time,
all by one clock, and none is starved; where the machine itself is halted for a while, time stands
still. A library that is preloaded (slow_motion/slow_motion.c) slows the clocks and waits of whole
programs by a page of memory that this module writes; programs without it, such as the map's, are in
real time.
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
from typing import Dict, Iterator, Optional, Tuple

import psutil

from fcsv_geometry.errors import FcsvError

AUTO = "auto"
LEAST_RATE = 0.35
_LIBRARY = "libfcsv_slow_motion.so"
_PRELOAD, _PAGE = "LD_PRELOAD", "FCSV_SLOW_MOTION"
_COUNT, _PART = struct.Struct("=Q"), struct.Struct("=qqqd")  # as struct page in slow_motion.c
_NO_HORIZON_NS = 2**63 - 1
_TICK_S, _AHEAD_S = 0.02, 0.08  # without a tick time stands still so much later
_PERIOD_S = 0.5
_BUSY = 0.85  # of the processors: what more is wanted, waits
# in a period: what is timed by one rate and ends at another is little off
_MOST_DOWN, _MOST_UP = 0.9, 1.05


class SlowMotionError(FcsvError):
    """A rate that cannot be, or a workspace that is not built; the message says which."""


class Page:
    """The clock that programs share. One process writes, any number read."""

    def __init__(self, path, create: bool = False):
        if create:
            Path(path).write_bytes(_COUNT.pack(0) + 2 * _PART.pack(0, 0, _NO_HORIZON_NS, 1.0))
        with open(path, "r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)

    @property
    def rate(self) -> float:
        return self._read()[3]

    def slow_s(self, now_s: float) -> float:
        """The slow time.monotonic() at a moment of the real one."""
        since_ns, lag_ns, horizon_ns, rate = self._read()
        return min(
            now_s - 1e-9 * lag_ns - (now_s - 1e-9 * since_ns) * (1.0 - rate), 1e-9 * horizon_ns
        )

    def now_s(self) -> float:
        """The slow time.monotonic(), for a process in real time."""
        return self.slow_s(time.monotonic())

    def write(self, now_s: float, rate: float, ahead_s: Optional[float] = None) -> None:
        """Real ``now_s``: from there on at ``rate``, and no further than ``ahead_s`` (slow) before
        the next write."""
        slow_s = self.slow_s(now_s)
        horizon_ns = _NO_HORIZON_NS if ahead_s is None else int(1e9 * (slow_s + ahead_s))
        count = _COUNT.unpack_from(self._map)[0] + 1
        _PART.pack_into(
            self._map,
            self._place(count),
            int(1e9 * now_s),
            int(1e9 * (now_s - slow_s)),
            horizon_ns,
            rate,
        )
        _COUNT.pack_into(self._map, 0, count)

    def _read(self) -> Tuple[int, int, int, float]:
        while True:
            count = _COUNT.unpack_from(self._map)[0]
            found = _PART.unpack_from(self._map, self._place(count))
            if _COUNT.unpack_from(self._map)[0] == count:  # else it may be half of the next
                return found

    @staticmethod
    def _place(count: int) -> int:
        return _COUNT.size + (count & 1) * _PART.size


def parse_rate(word: str) -> Optional[float]:
    """None for "auto". Raises SlowMotionError."""
    if word == AUTO:
        return None
    try:
        rate = float(word)
    except ValueError:
        rate = float("nan")
    if not LEAST_RATE <= rate <= 1.0:
        raise SlowMotionError(
            f"speed {word}: give {AUTO} or a share of real time, {LEAST_RATE:g} to 1"
        )
    return rate


@contextmanager
def slow_motion(rate: Optional[float] = None) -> Iterator[Page]:
    """What this process starts inside runs at ``rate``, or as fast as the machine has room for; it
    itself does not.

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
    """This program from its beginning in slow motion, in the same process; nothing where it already
    is or needs not be.

    Raises SlowMotionError.
    """
    if rate != 1.0 and _PAGE not in os.environ:
        os.environ.update(_changes(rate))
        os.execv(sys.executable, [sys.executable, *sys.argv])


def both_clocks() -> Tuple[float, float]:
    """This process's time.monotonic(), which may be slow, and the time since the machine started,
    which is not (s)."""
    return time.monotonic(), float(Path("/proc/uptime").read_text().split()[0])


def share_of_real_time(since: Tuple[float, float]) -> float:
    """How fast time passed for this process since a moment of ``both_clocks``."""
    (slow_s, real_s), now = since, both_clocks()
    return (now[0] - slow_s) / (now[1] - real_s)


def shared_time(env: Dict[str, str]) -> Dict[str, str]:
    """Gives, of an environment what makes a program share its time; empty in real time."""
    return {name: env[name] for name in (_PRELOAD, _PAGE) if _PAGE in env}


def in_real_time(env: Dict[str, str]) -> Dict[str, str]:
    """An environment whose programs are not slowed: those that measure how long they take."""
    return {name: value for name, value in env.items() if name not in shared_time(env)}


def _changes(rate: Optional[float]) -> Dict[str, str]:
    """Gives the changes of the environment; a page that begins now, and who keeps its rate until
    this process ends."""
    library = _library()
    handle, path = tempfile.mkstemp(prefix="fcsv-slow-motion-")
    os.close(handle)
    Page(path, create=True).write(time.monotonic(), 1.0 if rate is None else rate)
    keeper = [
        sys.executable,
        "-m",
        "fcsv_sim.machines.slow_motion",
        path,
        str(os.getpid()),
        *([] if rate else [AUTO]),
    ]
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
    """What keeps the processors (``busy``: 0 to 1) at their share of work, as work goes with the
    rate."""
    change = min(max(_BUSY / max(busy, 1e-3), _MOST_DOWN), _MOST_UP)
    return min(max(rate * change, LEAST_RATE), 1.0)


def _busy_and_all() -> Tuple[float, float]:
    """Seconds of all processors so far; what a hypervisor took away is not idle."""
    times = psutil.cpu_times()
    whole = sum(times[:8])  # guests' time is counted in user and nice
    return whole - times.idle - times.iowait, whole


def serve_first() -> None:
    """This process before others, where that is allowed: while it waits, time stands still for all
    of them."""
    try:
        os.setpriority(os.PRIO_PROCESS, 0, -20)
        Path("/proc/self/autogroup").write_text("-20")
    except OSError:
        return


def main() -> int:
    """The keeper of a page: adapts its rate where asked, and removes it once its process is no
    more."""
    parser = argparse.ArgumentParser(prog="slow_motion", description=main.__doc__)
    parser.add_argument("page")
    parser.add_argument("pid", type=int)
    parser.add_argument("rate", nargs="?", choices=[AUTO])
    args = parser.parse_args()
    try:
        page, last = Page(args.page), _busy_and_all()
    except FileNotFoundError:
        return 0  # it was over before this began
    serve_first()
    rate, due_s = page.rate, time.monotonic() + _PERIOD_S
    while os.getppid() == args.pid and os.path.exists(args.page):
        page.write(time.monotonic(), rate, _AHEAD_S)
        time.sleep(_TICK_S)
        if args.rate == AUTO and time.monotonic() > due_s:
            now = _busy_and_all()
            rate = next_rate(rate, (now[0] - last[0]) / max(now[1] - last[1], 0.01))
            last, due_s = now, time.monotonic() + _PERIOD_S
    page.write(time.monotonic(), 1.0)  # what is left behind must be able to end
    Path(args.page).unlink(missing_ok=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
