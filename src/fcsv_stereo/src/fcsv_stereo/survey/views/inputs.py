# SPDX-License-Identifier: Apache-2.0
"""The inputs of a survey: what each is, its name, its station, and the key of its content."""

import hashlib
import itertools
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import InputError
from fcsv_stereo.model.words import Word
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.photos.tags import read_tags
from fcsv_stereo.posed import colmap
from fcsv_stereo.posed.posed_pictures import find_files
from fcsv_stereo.sessions import is_session, session_views
from fcsv_stereo.survey.views import station
from fcsv_stereo.survey.views.station import Station

_MAP_FILES = ("report.json", "depth.npy", "sigma.npy", "kind.npy", "reference.png")
#: Not part of what a map is made of: the place of a view, truth, and what maps and browsers leave.
_NOT_CONTENT = {station.FILE, "truth", ".DS_Store", "Thumbs.db"}
_AT_A_TIME = 1 << 20


class SourceKind(Word):
    """What an input is."""

    MAP = "map"
    SESSION = "session"
    PHOTOGRAPHS = "photographs"


@dataclass(frozen=True)
class Source:
    """An input: its folder (or bag), the name of its view, what it is, and where its reference
    camera stood, where it says so; ``reference``: of photographs the reference picture, empty for
    the first.

    ``view``: of a session with several views, which; ``leads``: it is the first of its input;
    ``in_site``: home of its flight is the site's frame.
    """

    path: Path
    name: str
    kind: SourceKind
    station: Optional[Station]
    reference: str = ""
    view: str = ""
    leads: bool = True
    in_site: bool = False

    @property
    def level(self) -> bool:
        """Whether gravity made home's z point up, as in flights. A map's folder does not say what
        it was made of."""
        return self.kind is SourceKind.SESSION


def sources_of(paths: Sequence[Path], every: int = 0) -> List[Source]:
    """All inputs, in order; ``every``: of folders of photographs each so-manieth picture is the
    reference of a view (0: the first alone). Raises InputError on one that is none, ConfigError on
    a wrong station.yaml."""
    if every < 0:
        raise InputError(f"--every: is 1 or more, got {every}")
    kinds = [kind_of(p) for p in paths]
    names = names_of(paths)
    found: List[Source] = []
    for path, name, kind in zip(paths, names, kinds):
        source = Source(path, name, kind, station.load_station(path))
        if kind is SourceKind.SESSION:
            found += views_of(source, alone=len(paths) == 1)
        else:
            several = every > 0 and kind is SourceKind.PHOTOGRAPHS
            found += references_of(source, every) if several else [source]
    names = different([s.name for s in found])
    return _in_one_site([replace(s, name=n) for s, n in zip(found, names)])


def views_of(source: Source, alone: bool) -> List[Source]:
    """A view for each station and heading of a session; the session itself where it has one. Its
    name stands before theirs, unless it is ``alone``. Raises InputError."""
    views = session_views(source.path)
    if len(views) < 2:
        return [source]
    before = "" if alone else f"{source.name}-"
    return [
        replace(source, name=before + _file_name(view), view=view, leads=i == 0)
        for i, view in enumerate(views)
    ]


def _in_one_site(sources: List[Source]) -> List[Source]:
    """Where no input says its station, the first flight from stations gives the site its frame."""
    flights = [s.path for s in sources if s.view]
    if not flights or any(s.station for s in sources):
        return sources
    return [replace(s, in_site=bool(s.view) and s.path == flights[0]) for s in sources]


def _file_name(view: str) -> str:
    """
    >>> _file_name("north gate at -30 deg")
    'north_gate_at_-30_deg'
    """
    return re.sub(r"[^\w.-]+", "_", view)


def references_of(source: Source, every: int) -> List[Source]:
    """A view for each ``every``-th photograph in the order of images.txt; the station is the first
    one's. Raises InputError."""
    cameras = colmap.read_cameras(source.path / "cameras.txt")
    pictures = [p.name for p in colmap.read_images(source.path / "images.txt", cameras)][::every]
    stems = [str(Path(p).with_suffix("")).replace("/", "-") for p in pictures]
    return [
        replace(
            source,
            name=f"{source.name}-{s if stems.count(s) == 1 else p.replace('/', '-')}",
            station=source.station if i == 0 else None,
            reference=p,
        )
        for i, (p, s) in enumerate(zip(pictures, stems))
    ]


def source_keys(sources: Sequence[Source]) -> Dict[str, str]:
    """Keys of views by name; a folder of many references is read once."""
    contents = {path: content_key(path) for path in {s.path for s in sources}}
    return {s.name: source_key(s, contents[s.path]) for s in sources}


def source_key(source: Source, content: str) -> str:
    """Key of a view's content: that of its input, and of its reference or view where one is
    named."""
    part = source.reference or source.view
    return f"{content} {part}" if part else content


def kind_of(path: Path) -> SourceKind:
    """Raises InputError where a path is no input."""
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    if path.is_dir() and all((path / f).is_file() for f in _MAP_FILES):
        return SourceKind.MAP
    if is_session(path):
        return SourceKind.SESSION
    if path.is_dir() and colmap.is_model(path):
        return SourceKind.PHOTOGRAPHS
    raise InputError(
        f"{path}: is neither a session (session.yaml or bags), nor posed photographs (images/, images.txt), nor a "
        "folder that 'map' wrote"
    )


def names_of(paths: Sequence[Path]) -> List[str]:
    """A name for each view: its folder's, with as many folders above as tell it from the others.

    >>> names_of([Path("a/session"), Path("b/session"), Path("north")])
    ['a-session', 'b-session', 'north']
    >>> names_of([Path("north"), Path("north"), Path("north-2")])
    ['north', 'north-3', 'north-2']
    """
    parts = [tuple(w for w in p.absolute().resolve().parts if w != "/") or ("view",) for p in paths]
    depth = dict.fromkeys(parts, 1)
    while True:
        names = {words: "-".join(words[-n:]) for words, n in depth.items()}
        alike = [
            words
            for words in depth
            if list(names.values()).count(names[words]) > 1 and depth[words] < len(words)
        ]
        if not alike:
            break
        for words in alike:
            depth[words] += 1
    return different([names[words] for words in parts])  # the same folder may stand there again


def different(names: Sequence[str]) -> List[str]:
    """The names, of which those that stood before get the next number that none has.

    >>> different(["photos-1", "a", "photos-1"])
    ['photos-1', 'a', 'photos-1-2']
    """
    found: List[str] = []
    for name in names:
        free = (f"{name}-{n}" for n in itertools.count(2))
        found.append(
            next(f for f in free if f not in names and f not in found) if name in found else name
        )
    return found


def content_key(path: Path) -> str:
    """SHA-256 of the names and bytes of what a map is made of."""
    digest = hashlib.sha256()
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    for file in files:
        words = file.relative_to(path).parts if path.is_dir() else (file.name,)
        if _NOT_CONTENT & set(words):
            continue
        digest.update("/".join(words).encode() + b"\0" + str(file.stat().st_size).encode() + b"\0")
        with file.open("rb") as content:
            for block in iter(lambda: content.read(_AT_A_TIME), b""):
                digest.update(block)
    return digest.hexdigest()


def photograph_of(source: Source, picture: str) -> Tuple[Optional[PinholeCamera], Optional[Gps]]:
    """The camera that took a photograph of an input, distortion included, and where by its own
    GPS; None where the input is of another kind, or does not say it."""
    if source.kind is not SourceKind.PHOTOGRAPHS:
        return None, None
    cameras = colmap.read_cameras(source.path / "cameras.txt")
    posed = {p.name: p for p in colmap.read_images(source.path / "images.txt", cameras)}
    if picture not in posed:
        return None, None
    file = find_files(source.path / "images", list(posed))[picture]
    return cameras[posed[picture].camera_id], read_tags(file).gps


def copies(keys: Dict[str, str]) -> Dict[str, str]:
    """Gives, by name: the earlier view whose content is the same.

    >>> copies({"a": "1", "b": "2", "c": "1"})
    {'c': 'a'}
    """
    first: Dict[str, str] = {}
    found = {}
    for name, key in keys.items():
        if key in first:
            found[name] = first[key]
        first.setdefault(key, name)
    return found
