# SPDX-License-Identifier: Apache-2.0
"""Collects the bags of a flight from its machines into one session folder; what decides, and rsync
as the carrier.

Nothing is removed from a machine. A transfer that was cut off goes on where it ended.
"""

import re
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable, Dict, List, Optional

from fcsv_control.errors import SessionError
from fcsv_control.session import FILE, Session, save_session, with_part
from fcsv_geometry import config
from fcsv_geometry.bags.parts import part_number
from fcsv_geometry.bags.repair import ACTIVE, KEPT, recording_of, repaired
from fcsv_geometry.errors import BagError, ConfigError

#: A machine that is switched off, or whose radio goes in the middle, ends the transfer and not the
#: patience.
RSH = "ssh -o ConnectTimeout=10 -o ServerAliveInterval=5 -o ServerAliveCountMax=3"
_PARTIAL = ".gathering"  # where rsync keeps what was transferred of a file so far
_LISTED = re.compile(r"^-\S+\s+(?P<size>[\d,]+) \S+ \S+ (?P<name>.+)$")
_TRANSFERRED = re.compile(r"^\s*(?P<bytes>[\d,]+)\s+\d+%")
_KEPT = ("session.yaml", "poi.yaml", "console_events_*.csv")
_SPARE_BYTES = 64 << 20
Told = Callable[[int], None]


@dataclass(frozen=True)
class BagSource:
    """A machine's folder, as rsync names it: HOST:FOLDER over ssh, or a folder of this computer."""

    machine: str
    place: str


@dataclass
class Gathered:
    """What is in the session folder now, by machine, and what is not as it should be."""

    bags: Dict[str, List[str]] = field(default_factory=dict)
    problems: List[str] = field(default_factory=list)


def parse_source(text: str) -> BagSource:
    """NAME=PLACE. Raises SessionError.

    >>> parse_source("uav1=pilot@192.168.8.11:fcsv/session")
    BagSource(machine='uav1', place='pilot@192.168.8.11:fcsv/session')
    """
    machine, equals, place = text.partition("=")
    if not equals or not machine.isidentifier() or not place or place.startswith("-"):
        raise SessionError(f"'{text}' is not NAME=HOST:FOLDER or NAME=FOLDER")
    return BagSource(machine, place.rstrip("/") + "/")


def bags_in(listing: str, machine: str) -> Dict[str, int]:
    """Names and sizes of a machine's bags in what ``rsync --list-only`` says; those that were moved
    aside are not its.

    >>> bags_in("-rw-r--r--        1,234 2026/01/02 03:04:05 uav1.1.bag.active", "uav1")
    {'uav1.1.bag.active': 1234}
    """
    found = {}
    for match in filter(None, map(_LISTED.match, listing.splitlines())):
        if part_number(match["name"], f"{machine}.bag") >= 0:
            found[match["name"]] = int(match["size"].replace(",", ""))
    return found


class Gatherer:
    """Gathers into ``folder``; ``rsh``: the remote shell's command. Raises SessionError where
    nothing can be."""

    def __init__(self, folder: Path, rsh: str = RSH):
        if shutil.which("rsync") is None:
            raise SessionError("rsync is not installed: apt install rsync (on the vehicles too)")
        self.folder, self._rsh = folder, rsh
        folder.mkdir(parents=True, exist_ok=True)
        self.gathered = Gathered()

    def list(self, source: BagSource) -> Dict[str, int]:
        """What a machine has; a machine that does not answer is a problem, and not the end."""
        try:
            listing = self._rsync("--list-only", "--no-h", source.place)
        except SessionError as error:
            self.gathered.problems.append(f"{source.machine}: {error}")
            return {}
        found = bags_in(listing, source.machine)
        if not found:
            self.gathered.problems.append(
                f"{source.machine}: there is no {source.machine}.bag in {source.place}"
            )
        return found

    def lacking(self, there: Dict[str, int]) -> Dict[str, int]:
        """Those of a machine's bags that are not here yet, whole or as the original of a repair."""
        return {
            n: size
            for n, size in there.items()
            if size not in (self._size(n), self._size(_original(n)))
        }

    def require_room(self, sizes: Dict[str, int]) -> None:
        """Raises SessionError where the disk has less than these bags need."""
        need = (
            sum(max(size - (self._size(f"{_PARTIAL}/{n}") or 0), 0) for n, size in sizes.items())
            + _SPARE_BYTES
        )
        free = shutil.disk_usage(self.folder).free
        if need > free:
            raise SessionError(
                f"{self.folder}: {need >> 20} MiB are needed, {free >> 20} are free; make room first"
            )

    def fetch(self, source: BagSource, there: Dict[str, int], told: Told) -> None:
        """Transfer, compare by checksum, repair what was not closed. ``told``: bytes that have
        come."""
        wanted = self.lacking(there)
        try:
            if wanted:
                options = [
                    "--times",
                    "--no-whole-file",
                    f"--partial-dir={_PARTIAL}",
                    "--info=progress2",
                    "--no-h",
                ]
                self._rsync(*options, *self._these(source, wanted), told=told)
                differing = self._rsync(
                    "--checksum", "--dry-run", "--out-format=%n", *self._these(source, wanted)
                )
                grown = [n for n in differing.splitlines() if n]
                if grown:
                    names = ", ".join(grown)
                    raise SessionError(
                        f"{names} changed meanwhile: stop its recorder and gather again"
                    )
        except SessionError as error:
            self.gathered.problems.append(f"{source.machine}: {error}")
        self._set_aside(there)
        for name in there:
            self._accept(source.machine, name)

    def fetch_description(self, source: BagSource) -> None:
        """What the control PC keeps beside its bag, where it does: session.yaml, and the events of
        its windows."""
        try:
            kept = (f"--include={name}" for name in _KEPT)
            self._rsync(
                "--times", *kept, "--exclude=*", "--recursive", source.place, str(self.folder) + "/"
            )
        except SessionError as error:
            self.gathered.problems.append(f"{source.machine}: {error}")

    def describe(self) -> Optional[Path]:
        """session.yaml with every part that was found; names those that it lists and that are not
        here."""
        told = self.gathered
        try:
            session = config.load(self.folder / FILE, Session)
        except ConfigError as error:
            told.problems.append(f"{error}; `map` takes all bags of the folder")
            return None
        for machine, bags in told.bags.items():
            for bag in bags:
                session = with_part(session, machine, bag)
        for machine, first in session.bags.items():
            for bag in (first, *session.parts.get(machine, ())):
                if not (self.folder / bag).exists():
                    told.problems.append(f"{machine}: {bag} is missing; gather it from its machine")
        return save_session(self.folder, session)

    # ---- parts of it -----------------------------------------------------------------------------

    def _accept(self, machine: str, name: str) -> None:
        """A bag that has come: it can be read, or is repaired, or is a problem."""
        path = self.folder / name
        if not path.exists():
            path = recording_of(path)
        if not path.exists():
            return  # the transfer's problem was told
        try:
            bag, salvaged = repaired(path)
        except BagError as error:
            self.gathered.problems.append(f"{machine}: {error}")
            return
        if salvaged is not None:
            self.gathered.problems.append(
                f"{machine}: {name} was not closed or is damaged: repaired, {salvaged}"
            )
        self.gathered.bags.setdefault(machine, []).append(bag.name)

    def _set_aside(self, there: Dict[str, int]) -> None:
        """What an earlier gathering took of a bag that was not closed yet."""
        for name in there:
            early = self.folder / (name + ACTIVE)
            if not name.endswith(ACTIVE) and early.exists():
                early.rename(early.with_name(early.name + ".early"))

    def _these(self, source: BagSource, names: Dict[str, int]) -> List[str]:
        return [
            "--recursive",
            *(f"--include=/{n}" for n in names),
            "--exclude=*",
            source.place,
            str(self.folder) + "/",
        ]

    def _size(self, name: str) -> Optional[int]:
        path = self.folder / name
        return path.stat().st_size if path.is_file() else None

    def _rsync(self, *arguments: str, told: Optional[Told] = None) -> str:
        """Its output. Raises SessionError with its last words."""
        command = ["rsync", f"--rsh={self._rsh}", *arguments]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            try:
                lines = []
                for line in process.stdout:  # a line ends with \r too: text mode takes it as an end
                    match = _TRANSFERRED.match(line)
                    if match and told is not None:
                        told(int(match["bytes"].replace(",", "")))
                    lines.append(line)
                words = process.stderr.read().strip().splitlines()
            except BaseException:
                process.terminate()
                raise
        if process.returncode:
            last = words[0] if words else f"rsync ended with {process.returncode}"
            raise SessionError(f"{last}; what has come is kept: gather again")
        return "".join(lines)


def _original(name: str) -> str:
    return recording_of(Path(name)).name + KEPT
