# SPDX-License-Identifier: Apache-2.0
"""Where a command will write: looked at before the work begins; and what the system says of files,
as a sentence."""

import contextlib
import errno
import shutil
import tempfile
from pathlib import Path
from typing import Iterator

from fcsv_geometry.errors import FcsvError

_FULL = "the disk is full: make room, or choose another folder"
_SENTENCES = {
    errno.ENOSPC: _FULL,
    errno.EDQUOT: _FULL,
    errno.EFBIG: "files may not become so large here (ulimit -f)",
    errno.EACCES: "this user may not write here: choose another folder, or change its owner",
    errno.EPERM: "this user may not write here: choose another folder, or change its owner",
    errno.EROFS: "the disk is read-only: choose another folder",
    errno.ENOTDIR: "a file stands where a folder should be: choose another folder",
    errno.EEXIST: "a file stands where a folder should be: choose another folder",
    errno.EISDIR: "is a folder, not a file",
    errno.ENOENT: "does not exist",
}
_MIB = 1 << 20


class OutputPlaceError(FcsvError):
    """Nothing can be written there."""


def require_folder(folder: Path, least_mib: int = 1) -> None:
    """A folder that exists, or can be made, takes files and ``least_mib`` MiB. Nothing is left.
    Raises PlaceError."""
    folder = Path(folder).absolute()
    there = next(p for p in (folder, *folder.parents) if p.exists())
    if not there.is_dir():
        raise OutputPlaceError(f"{there}: a file stands there, not a folder: choose another")
    try:
        tempfile.TemporaryFile(dir=there).close()
        free_mib = shutil.disk_usage(there).free // _MIB
    except OSError as error:
        # not its file
        raise OutputPlaceError(
            in_words(OSError(error.errno, error.strerror, str(there)))
        ) from error
    if free_mib < least_mib:
        raise OutputPlaceError(
            f"{there}: {free_mib} MiB are free, {least_mib} are needed: make room, or choose another"
        )


def require_file(file: Path) -> None:
    """A file that can be written, in place of one that may stand there. Raises PlaceError."""
    if Path(file).is_dir():
        raise OutputPlaceError(f"{file}: is a folder: name a file")
    require_folder(Path(file).absolute().parent)


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A place to write, which is ``path`` when the block ends well, and else gone; in a folder that
    is made where it is not there. Raises OSError."""
    partial = path.with_name(path.name + ".partial")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_whole(path: Path, text: str) -> None:
    """A file, whole or not at all, as ``whole_file``. Raises OSError."""
    with whole_file(path) as partial:
        partial.write_text(text)


def in_words(error: OSError, place: object = "") -> str:
    """One line: which file, what is wrong, what to do. ``place``: where the work was, if the error
    does not say.

    >>> in_words(OSError(errno.ENOSPC, "No space left on device"), "out/map")
    'out/map: the disk is full: make room, or choose another folder'
    """
    named = (error.filename2, error.filename, place)  # of a move its end is what people know
    where = next(n for n in named if n is not None)
    what = _SENTENCES.get(error.errno) or error.strerror or str(error) or type(error).__name__
    if error.errno is None and _full(place):  # numpy tells of a full disk without a number
        what = _FULL
    return f"{where}: {what}" if str(where) else what


def _full(place: object) -> bool:
    try:
        there = next(
            p
            for p in (Path(str(place)).absolute(), *Path(str(place)).absolute().parents)
            if p.exists()
        )
        return shutil.disk_usage(there).free < _MIB
    except OSError:
        return False
