# SPDX-License-Identifier: Apache-2.0
"""The recorder's process without its transport and its disk: what comes in, what is to be written
and told out."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, List, Optional, Sequence

from fcsv_control.agent.messages import Pictures
from fcsv_control.disk import DiskWatch
from fcsv_control.recording import RecorderParameters
from fcsv_control.session import Session, with_part
from fcsv_geometry.streams.dispatch import Takers
from fcsv_geometry.streams.silence import Silence, in_steps
from fcsv_geometry.vehicles.telemetry import Diagnosis


@dataclass(frozen=True)
class PictureCame:
    """A message on a topic of pictures, as it came; ``image``: not its camera_info. The port gives
    it back where it is to be written."""

    topic: str
    message: Any
    image: bool


@dataclass(frozen=True)
class Written:
    """What the writer did until now: the part that it writes (``path``), counts, what is wrong
    (empty: nothing); ``free_bytes`` on its disk."""

    path: str
    pictures: int
    bytes: int
    dropped: int
    problem: str
    free_bytes: int


@dataclass(frozen=True)
class PartWritten:
    """Another machine's recorder writes this bag."""

    machine: str
    bag: str


@dataclass(frozen=True)
class SaveSession:
    """session.yaml is to be written; given again until it was received as SessionSaved."""

    session: Session


@dataclass(frozen=True)
class SessionSaved:
    """session.yaml holds this."""

    session: Session


@dataclass(frozen=True)
class EndRecording:
    """Nothing more is to be written; what is there is closed."""

    why: str


@dataclass(frozen=True)
class RecorderReport:
    """What the recorder tells of itself; fields as in fcsv_msgs/RecorderStatus."""

    path: str
    pictures_on: bool
    pictures: int
    bytes: int
    dropped: int
    minutes_left: float
    problem: str


class RecorderPort:
    """``session``: what session.yaml holds, None on a vehicle. Step it after each message.

    Gives PictureCame, SaveSession, EndRecording, and RecorderReport with its Diagnosis for each
    Written.
    """

    def __init__(self, p: RecorderParameters, now_s: float, session: Optional[Session] = None):
        self._name, self._folder, self._least_mib = p.name, p.folder, p.least_free_mib
        self._session = self._saved = session
        self._silence, self._disk = Silence(p.no_picture_s), DiskWatch(p.least_free_mib << 20)
        self._pictures_on = False
        self._out: List[object] = []
        self._take = Takers(
            {
                Pictures: self._wanted,
                PictureCame: self._picture,
                PartWritten: lambda _now_s, m: self._list(m.machine, m.bag),
                SessionSaved: lambda _now_s, m: setattr(self, "_saved", m.session),
                Written: self._written,
            },
            "a recorder takes no",
        )
        self._wanted(now_s, Pictures(p.pictures_on))

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known."""
        self._take[type(message)](now_s, message)

    def step(self, _now_s: float) -> Sequence[object]:
        """What is to be done now."""
        out, self._out = self._out, []
        return out

    def _wanted(self, now_s: float, m: Pictures) -> None:
        self._pictures_on = m.on
        self._silence.want(now_s, m.on)

    def _picture(self, now_s: float, m: PictureCame) -> None:
        if self._pictures_on:
            if m.image:
                self._silence.came(now_s)
            self._out.append(m)

    def _list(self, machine: str, bag: str) -> None:
        """A further part of a machine's recording belongs into session.yaml."""
        if self._session is None:
            return
        self._session = with_part(self._session, machine, bag)
        if self._session != self._saved:
            self._out.append(SaveSession(self._session))

    def _written(self, now_s: float, m: Written) -> None:
        self._disk.update(now_s, m.bytes, m.free_bytes)
        if self._disk.full and not m.problem:
            mib = f"less than {self._least_mib} MiB are free"
            why = f"{mib} on the disk of {self._folder}; make room and start again"
            self._out.append(EndRecording(why))
            m = replace(m, problem=why)
        self._list(self._name, Path(m.path).name)
        left, lasts_s = self._disk.minutes_left, in_steps(self._silence.lasts_s(now_s))
        silent = f"{self._name}: no picture for {lasts_s} s" if lasts_s else ""
        values = {"minutes left": f"{left:.0f}", "pictures": m.pictures, "MB": m.bytes // 10**6}
        self._out.append(Diagnosis({"disk": m.problem, "pictures": silent}, values))
        self._out.append(
            RecorderReport(
                m.path, self._pictures_on, m.pictures, m.bytes, m.dropped, left, m.problem
            )
        )
