# SPDX-License-Identifier: Apache-2.0
"""The maps of a survey, kept in OUT/views/NAME with the key of what went into them, so that a
stopped run goes on."""

import json
import re
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Optional, Tuple

from fcsv_geometry.programs.writing import write_whole
from fcsv_geometry.version import VERSION
from fcsv_stereo import pipeline
from fcsv_stereo.model import Progress, silent
from fcsv_stereo.survey.document import withdraw
from fcsv_stereo.survey.views.inputs import Source, SourceKind, content_key, source_key

VIEWS = "views"
_THREADS = re.compile(r",? ?threads=\d+")  # a machine's, and no matter to the map


@dataclass(frozen=True)
class MapOptions:
    """How the maps are made: method, and its options."""

    method: str = pipeline.DEFAULT_METHOD
    options: Any = None

    def made(self) -> Any:
        """The method's options."""
        return pipeline.METHODS[self.method].options() if self.options is None else self.options

    def on_one_core(self) -> "MapOptions":
        """The same with one thread: for processes that share a machine. The map is the same."""
        return replace(self, options=_with_one_thread(self.made()))

    def words(self) -> str:
        """What tells these options from others."""
        return _THREADS.sub("", f"{VERSION} {self.method} {self.made()!r}")


def _with_one_thread(options: Any) -> Any:
    """A dataclass with 1 for its fields ``threads``, and those of the dataclasses in it."""
    changed = {}
    for f in fields(options):
        value = getattr(options, f.name)
        if is_dataclass(value):
            changed[f.name] = _with_one_thread(value)
        elif f.name == "threads":
            changed[f.name] = 1
    return replace(options, **changed)


def kept_map(source: Source, content: str, out: Path, options: MapOptions) -> Optional[Path]:
    """The folder of the source's map where it is there: its own where it is one, else
    OUT/views/NAME. ``content`` is the source's key."""
    if source.kind is SourceKind.MAP:
        return source.path
    folder, note = _places(source, out)
    if (folder / "report.json").is_file() and _noted(note) == _key(content, options):
        return folder
    return None


def _places(source: Source, out: Path) -> Tuple[Path, Path]:
    return out / VIEWS / source.name, out / VIEWS / f"{source.name}.json"


def make_map(
    source: Source, content: str, out: Path, options: MapOptions, progress: Progress = silent
) -> Path:
    """A task: makes the source's map in OUT/views/NAME.

    Raises FcsvError or OSError where no map can be made; an earlier one of that name is left then.
    """
    folder, note = _places(source, out)
    if folder.exists():
        withdraw(out)
    note.unlink(missing_ok=True)  # a map without a note is made again
    pipeline.run(_request(source, folder, options), progress)
    if source.kind is SourceKind.SESSION:  # bags may have been repaired meanwhile
        content = source_key(source, content_key(source.path))
    document = {**_key(content, options), "input": str(source.path)}
    write_whole(note, json.dumps(document, indent=1))
    return folder


def forget_map(source: Source, out: Path) -> str:
    """Has a damaged map made again by the next survey, unless it is an input; the remedy in words."""
    if source.kind is SourceKind.MAP:
        return ""
    _places(source, out)[1].unlink(missing_ok=True)
    return "; the same command makes it again"


def _request(source: Source, folder: Path, options: MapOptions) -> pipeline.MapRequest:
    reference = source.reference or None
    return pipeline.MapRequest(
        source.path, folder, options.method, options.made(), reference=reference, view=source.view
    )


def _key(content: str, options: MapOptions) -> dict:
    return {"content": content, "options": options.words()}


def _noted(note: Path) -> dict:
    """The key of the map that is there; empty where nothing tells."""
    try:
        document = json.loads(note.read_text())
        return {k: document[k] for k in ("content", "options")}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
