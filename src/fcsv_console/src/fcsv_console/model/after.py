# SPDX-License-Identifier: Apache-2.0
"""Leads on after the flight: gather the bags, make the map, open the report. What can be done now,
and why not."""

import math
from dataclasses import dataclass, replace
from typing import Dict, Sequence, Tuple

from fcsv_console.model import facts as f

GATHER, MAP, REPORT = "gather", "map", "report"
RUNS, DONE, FAILED, STOPPED = "runs", "done", "failed", "stopped"
_WORDS = {RUNS: "", DONE: "done", FAILED: "FAILED", STOPPED: "stopped"}


@dataclass(frozen=True)
class Places:
    """``sources``: as ``gather_session`` takes them, with blanks between; ``session``: where to;
    ``out``: the map."""

    sources: str = ""
    session: str = ""
    out: str = ""


@dataclass(frozen=True)
class Step:
    """``share`` (0..1) of one that runs, NaN: not known; ``words``: what it says, or said last."""

    name: str
    title: str
    does: str
    state: str = ""
    share: float = math.nan
    words: str = ""
    why_not: str = ""
    next: bool = False  # it is what comes next

    @property
    def summary(self) -> str:
        """Says it in one line."""
        return ": ".join(w for w in (_WORDS.get(self.state, ""), self.words) if w)

    @property
    def tooltip(self) -> str:
        """What it does, or that it is stopped by it, and why it cannot be done."""
        if self.state == RUNS:
            return "Stop it"
        return self.does + (f"\nNot now: {self.why_not}" if self.why_not else "")


_STEPS = (
    Step(
        GATHER,
        "Gather",
        "Collect the bags of all machines into the session's folder; what is there already stays",
    ),
    Step(MAP, "Map", "Make the map of the session"),
    Step(REPORT, "Report", "Open the map's report"),
)


class AfterFlight:
    """Keeps what was heard of the jobs."""

    def __init__(self) -> None:
        self.places = Places()
        self._told: Dict[str, f.JobProgress] = {}
        self._found = f.PlacesFound(False, False)

    def tell(self, fact: f.Fact) -> None:
        """What became of a job, or what is on the disk."""
        if isinstance(fact, f.PlacesFound):
            self._found = fact
            return
        before = self._told.get(fact.job)
        if (
            fact.state == RUNS
            and before is not None
            and before.state == RUNS
            and math.isnan(fact.share)
        ):
            fact = replace(fact, share=before.share)
        self._told[fact.job] = fact

    def steps(self, armed: Sequence[str]) -> Tuple[Step, ...]:
        """``armed``: vehicles whose motors run, or that were not heard since they did."""
        steps = tuple(self._step(step, armed) for step in _STEPS)
        runs = any(step.state == RUNS for step in steps)
        # the last one that can be done
        can = [step.name for step in reversed(steps) if not step.why_not]
        return tuple(replace(step, next=not runs and step.name in can[:1]) for step in steps)

    def _step(self, step: Step, armed: Sequence[str]) -> Step:
        told = self._told.get(step.name, f.JobProgress(step.name, ""))
        why = "" if told.state == RUNS else self._why_not(step.name, armed)
        share = told.share if told.state == RUNS else math.nan
        return replace(step, state=told.state, share=share, words=told.words, why_not=why)

    def _why_not(self, name: str, armed: Sequence[str]) -> str:
        running = next((job for job, told in self._told.items() if told.state == RUNS), "")
        if name == REPORT:
            return (
                ""
                if self._found.report
                else f"there is no report in {self.places.out or 'the folder of the map'}"
            )
        if armed:
            return f"the motors of {', '.join(armed)} run: radio and processor are the flight's"
        if running:
            return f"'{running}' runs"
        if not self.places.session:
            return "name the session's folder"
        if name == GATHER:
            if not self.places.sources and self._found.session:
                return (
                    f"nothing is to be gathered: all machines recorded into {self.places.session}"
                )
            return (
                ""
                if "=" in self.places.sources
                else "name the machines: NAME=HOST:FOLDER, or NAME=FOLDER"
            )
        if not self.places.out:
            return "name a folder for the map"
        if not self._found.session:
            return f"there is neither session.yaml nor a bag in {self.places.session}: gather first"
        if self._found.recording:
            return f"a bag in {self.places.session} is still written: the flight's machines are not stopped yet"
        return (
            f"another command makes a map in {self.places.out} just now"
            if self._found.mapping
            else ""
        )


def judged(job: str, status: int, last: str) -> f.JobProgress:
    """Judges a command from a command's exit status and its last line.

    >>> judged("map", 2, "map: out/flight: no session.yaml").words
    'out/flight: no session.yaml'
    >>> judged("gather", 1, "uav2: there is no uav2.bag").state
    'failed'
    """
    words = last.split(": ", 1)[-1] if last.startswith(("map: ", "gather_session: ")) else last
    return f.JobProgress(
        job,
        DONE if status == 0 else FAILED,
        words=words or ("" if status == 0 else f"status {status}"),
    )
