# SPDX-License-Identifier: Apache-2.0
"""Who computes: a plain loop, processes of this machine, or a cluster that exists (Dask).

A task reads and writes files and gives back little, so that it may run anywhere that sees the same
disk. All three give the same results: tasks depend on their arguments alone, and each computes with
one thread of linear algebra.
"""

import contextlib
import functools
import itertools
import logging
import os
import signal
import sys
import threading
import uuid
from dataclasses import dataclass
from multiprocessing import resource_tracker
from queue import Empty, Queue
from typing import Any, Callable, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple

import cv2
import psutil
from threadpoolctl import threadpool_limits

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs.writing import in_words
from fcsv_stereo.errors import SurveyError
from fcsv_stereo.model import Progress, silent

#: Hears how far a task is: its number, step, share.
Told = Callable[[int, str, float], None]
#: So many tasks that take long, or so many in all, are worth a start of processes (5 s each).
_WORTH_LONG, _WORTH = 2, 40
_FAILURES = 3  # workers that a task may take with it
_LEAST_BYTES = 256 << 20
_IN_FLIGHT = 256  # tasks that the scheduler knows of at a time; it runs in this process


@dataclass(frozen=True)
class SurveyTask:
    """``call(*args)`` with a ``name`` for people; ``long``: it takes many seconds; ``tells``: it
    takes an argument ``progress`` besides."""

    name: str
    call: Callable
    args: Tuple
    long: bool = False
    tells: bool = False


@dataclass(frozen=True)
class TaskResult:
    """Holds, of a task by its number, its result, or ``error``: a line that says why there is none."""

    number: int
    result: Any
    error: str = ""


_ENVIRONMENT = "distributed.nanny.pre-spawn-environ"
_DASK = {
    "distributed.scheduler.allowed-failures": _FAILURES,
    # a worker's statistics of where its time goes: 3 MB more with each map
    "distributed.worker.profile.enabled": False,
    # Dask's own has glibc give each large array back to the system: a quarter of a map's time
    f"{_ENVIRONMENT}.MALLOC_TRIM_THRESHOLD_": 128 << 20,
    f"{_ENVIRONMENT}.MALLOC_MMAP_THRESHOLD_": 32 << 20,
    f"{_ENVIRONMENT}.MALLOC_ARENA_MAX": 1,
}


@dataclass(frozen=True)
class WorkOptions:
    """``workers``: processes (None: one a core; 0: a plain loop in this one); ``memory``: of each,
    as "4GB" (empty: an equal share of what the machine has); ``scheduler``: address of a cluster
    instead (tcp://...); ``limit_s``: a time without any result after which workers are renewed.

    Raises SurveyError on a wrong one.
    """

    workers: Optional[int] = None
    memory: str = ""
    scheduler: str = ""
    limit_s: float = 3600.0

    def __post_init__(self):
        if self.workers is not None and self.workers < 0:
            raise SurveyError(f"--workers: is 0 or more, got {self.workers}")
        if self.scheduler and (self.workers is not None or self.memory):
            raise SurveyError(
                "--scheduler has workers of its own; leave --workers and --memory-per-worker away"
            )
        if self.scheduler and "://" not in self.scheduler:
            raise SurveyError(f"--scheduler: is tcp://HOST:PORT, got {self.scheduler}")
        if self.memory:
            self.memory_bytes()

    @property
    def processes(self) -> int:
        """Processes on this machine."""
        return _cores() if self.workers is None else self.workers

    def memory_bytes(self) -> int:
        """Bound of each process. Raises SurveyError."""
        if not self.memory:
            return psutil.virtual_memory().total // max(self.processes, 1)
        from dask.utils import parse_bytes

        try:
            found = int(parse_bytes(self.memory))
        except ValueError as error:
            raise SurveyError(f"--memory-per-worker: is as 4GB, got {self.memory}") from error
        if found < _LEAST_BYTES:
            raise SurveyError(f"--memory-per-worker: at least 256MiB are needed, got {self.memory}")
        return found


def _cores() -> int:
    """Processors that this process may use; not all systems say it."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def attempt_on_one_core(task: SurveyTask, number: int, topic: str) -> Tuple[Any, str]:
    """Does what ``attempt`` does, in a worker that shares its machine with others. Its progress
    goes to those who listen to the ``topic``, with the task's ``number``."""
    from distributed import get_worker

    cv2.setNumThreads(1)
    worker = get_worker()
    return attempt(task, lambda step, share: worker.log_event(topic, (number, step, share)))


def attempt(task: SurveyTask, progress: Progress) -> Tuple[Any, str]:
    """A task's result, or the line of the error that its input makes."""
    with threadpool_limits(1):
        try:
            return task.call(*task.args, **({"progress": progress} if task.tells else {})), ""
        except (FcsvError, ValueError) as error:
            return None, str(error)
        except OSError as error:
            return None, in_words(error, error.filename or "")


class Crew:
    """Runs tasks by the options; its processes start with the first tasks that are worth it. A
    context manager: they end with it."""

    def __init__(self, options: WorkOptions):
        self._options = options
        self._client: Any = None
        self._cluster: Any = None  # of this machine
        self._open = contextlib.ExitStack()

    def __enter__(self) -> "Crew":
        return self

    def __exit__(self, kind, *_) -> None:
        if kind is not None:
            self._kill_workers()
        self._open.close()
        self._client = self._cluster = None

    def run(
        self, tasks: Sequence[SurveyTask], told: Told = lambda *_: None
    ) -> Iterator[TaskResult]:
        """The outcome of each task, in the order in which they end. Raises SurveyError where the
        scheduler is not there.

        ``told`` hears how far tasks are that tell it: number, step, share; from any thread.
        """
        if not self.elsewhere(tasks):
            for i, task in enumerate(tasks):
                yield TaskResult(i, *attempt(task, functools.partial(told, i)))
            return
        yield from self._by_dask(tasks, told)

    def _kill_workers(self) -> None:
        """Ends this machine's workers at once; what they write is whole or not there. Asked to end,
        each would wait for its task first."""
        for nanny in self._cluster.workers.values() if self._cluster is not None else ():
            nanny.auto_restart = False
            with contextlib.suppress(psutil.NoSuchProcess):
                if nanny.pid is not None:
                    psutil.Process(nanny.pid).kill()

    def elsewhere(self, tasks: Sequence[SurveyTask]) -> bool:
        """Whether other processes run these tasks."""
        if not tasks or (self._options.processes < 2 and not self._options.scheduler):
            return bool(tasks) and self._options.processes == 1 and self._worth(tasks)
        return bool(self._options.scheduler) or self._client is not None or self._worth(tasks)

    @staticmethod
    def _worth(tasks: Sequence[SurveyTask]) -> bool:
        return sum(t.long for t in tasks) >= _WORTH_LONG or len(tasks) >= _WORTH

    def _by_dask(self, tasks: Sequence[SurveyTask], told: Told) -> Iterator[TaskResult]:
        from distributed import CancelledError
        from distributed.scheduler import KilledWorker

        client, topic = self._started(), f"survey-{uuid.uuid4()}"
        client.subscribe_topic(topic, lambda event: told(*event[1]))
        ended: Queue[Any] = Queue()  # waiting for the first of all left costs their square
        left: Dict[Any, int] = {}
        waiting = enumerate(tasks)

        def submit(most: int) -> None:
            for i, t in itertools.islice(waiting, most):
                future = client.submit(attempt_on_one_core, t, i, topic, pure=False)
                future.add_done_callback(ended.put)
                left[future] = i

        try:
            submit(_IN_FLIGHT)
            while left:
                try:
                    future = ended.get(timeout=self._options.limit_s)
                except Empty:
                    self._renew(left)
                    continue
                i = left.pop(future)
                submit(1)
                try:
                    yield TaskResult(i, *future.result())
                except KilledWorker:
                    yield TaskResult(i, None, _died(tasks[i].name))
        except (CancelledError, OSError) as error:
            raise SurveyError(
                f"the scheduler is gone ({type(error).__name__}); what was finished is kept: the same command goes on"
            ) from error

    def _renew(self, left: Iterable[Any]) -> None:
        """New workers for those that hang; their tasks are tried again."""
        keys = {f.key for f in left}
        busy = [w for w, of in self._client.processing().items() if keys & set(map(str, of))]
        if busy:
            self._client.restart_workers(busy)

    def _started(self):
        """The client of the cluster, which begins now if it does not run yet."""
        if self._client is None:
            import dask
            from distributed import Client, LocalCluster
            from distributed import TimeoutError as NoAnswer

            dask.config.set(_DASK)
            # a scheduler that goes is said in one line, without Dask's own
            logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
            o = self._options
            try:
                with _interrupted_later():
                    if not o.scheduler:
                        self._cluster = self._open.enter_context(
                            LocalCluster(
                                n_workers=o.processes,
                                threads_per_worker=1,
                                memory_limit=o.memory_bytes(),
                                dashboard_address="127.0.0.1:0",  # any port that is free
                                silence_logs=logging.CRITICAL,
                            )
                        )
                    address = o.scheduler or self._cluster
                    self._client = self._open.enter_context(Client(address, timeout=10))
            except (OSError, NoAnswer) as error:
                where = o.scheduler or "this machine"
                raise SurveyError(
                    f"no Dask scheduler at {where} ({error}); start it, or leave --scheduler away"
                ) from error
        return self._client


def completed(
    crew: Crew,
    tasks: Sequence[SurveyTask],
    kept: Callable[[int], Any],
    progress: Progress = silent,
    step: str = "",
) -> Tuple[List[Any], Dict[int, str]]:
    """What ``kept`` gives by each task's number, once those have run of which it gave None; and,
    by number, why there is nothing. ``progress`` hears of the ``step``."""
    new = [i for i in range(len(tasks)) if kept(i) is None]
    errors: Dict[int, str] = {}
    for done, outcome in enumerate(crew.run([tasks[i] for i in new]), 1):
        if outcome.error:
            errors[new[outcome.number]] = outcome.error
        progress(f"{step}, {done} of {len(new)}", done / len(new))
    found = [kept(i) for i in range(len(tasks))]
    gone = "what was written is gone; the same command goes on"
    return found, {i: errors.get(i, gone) for i, of in enumerate(found) if of is None}


@contextlib.contextmanager
def _interrupted_later() -> Iterator[None]:
    """Ctrl-C counts when the block is left, a second one at once. Threads that begin in the block,
    and their processes, never get it: this process ends them."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    pressed: List[int] = []

    def remember(number: int, frame: Any) -> None:
        if pressed:
            before(number, frame)
        pressed.append(number)

    signal.signal(signal.SIGINT, remember)
    _start_tracker()  # a thread that starts it unblocks the signal
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, before)
    if pressed:
        before(pressed[0], None)


def _start_tracker() -> None:
    """Starts what cleans up after processes; where this one ends at once, it does so without a
    warning."""
    sys.warnoptions.append("ignore:resource_tracker")
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.pop()


def kill_processes() -> None:
    """Ends all processes that this one started, but for the one that cleans up after them."""
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if not any("resource_tracker" in word for word in process.cmdline()):
                process.kill()


def _died(name: str) -> str:
    return (
        f"{name}: its worker died {_FAILURES + 1} times, as one does that needs more memory than it has; give "
        "--memory-per-worker more, or fewer --workers"
    )
