# SPDX-License-Identifier: Apache-2.0
"""A bag as rosbag can open it: one that was never closed or is damaged is repaired, and the
original is kept."""

import contextlib
import fcntl
import mmap
import os
import shutil
from pathlib import Path
from typing import Callable, Iterator, Optional, Tuple

from fcsv_geometry.bags.records import require_version
from fcsv_geometry.bags.salvage import Salvaged, is_whole, salvage
from fcsv_geometry.errors import BagError

ACTIVE = ".active"  # what a recorder appends to the name until the bag is whole
KEPT = ".broken"  # what the original's name ends with after a repair
_FIRST_LINE_BYTES = 32
_SPARE_BYTES = 1 << 20  # for the index of the new bag


def recording_of(path: Path) -> Path:
    """The name that a bag has, or will have once it is closed.

    >>> recording_of(Path("uav1.1.bag.active"))
    PosixPath('uav1.1.bag')
    """
    return path.with_name(path.name[: -len(ACTIVE)]) if path.name.endswith(ACTIVE) else path


def check(path: Path) -> bool:
    """Whether a bag is whole. Raises BagError where it is no bag of version 2.0, is recorded now,
    or cannot be read."""
    with _mapped(path) as buffer:
        return is_whole(buffer)


def repaired(
    path: Path, progress: Callable[[int], None] = lambda _bytes: None
) -> Tuple[Path, Optional[Salvaged]]:
    """The bag to open in place of ``path``, and what was salvaged (None where it was whole).

    A whole ``NAME.bag.active`` gets its name. Of another one the new bag is ``NAME.bag``, and the
    original is kept as ``NAME.bag.broken``. Raises BagError where it cannot be repaired; then
    nothing is changed.
    """
    target = recording_of(path)
    if target != path and target.exists():
        raise BagError(f"{path}: {target.name} is there too; move one of them away")
    partial = target.with_name(target.name + ".repairing")
    try:
        with _mapped(path) as buffer:
            found = None
            if not is_whole(buffer):
                _require_room(path, len(buffer))
                with partial.open("wb") as out:
                    found = salvage(buffer, out, progress)
                    out.flush()
                    os.fsync(out.fileno())
                if not found.messages:
                    raise BagError(f"{path}: holds no whole message; nothing can be repaired")
                _keep(path, target, partial)
            elif target != path:
                os.replace(path, target)
    except OSError as error:
        raise BagError(
            f"{path}: cannot be repaired in its folder ({error.strerror}); copy it elsewhere"
        ) from error
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()
    return target, found


def _keep(path: Path, target: Path, partial: Path) -> None:
    """The new bag under its name, the original under another; killed in between, none of both is
    lost."""
    kept, number = target.with_name(target.name + KEPT), 1
    while kept.exists():
        number += 1
        kept = target.with_name(f"{target.name}{KEPT}-{number}")
    if target == path:
        try:
            os.link(path, kept)
        except OSError:  # a file system without links
            os.replace(path, kept)
        os.replace(partial, target)
    else:
        os.replace(partial, target)
        os.replace(path, kept)


def _require_room(path: Path, size: int) -> None:
    free = shutil.disk_usage(path.parent).free
    if free < size + _SPARE_BYTES:
        need = f"{(size + _SPARE_BYTES) >> 20} MiB are needed on its disk, {free >> 20} are free"
        raise BagError(f"{path}: cannot be repaired: {need}")


@contextlib.contextmanager
def _mapped(path: Path) -> Iterator:
    """The file's bytes, which nobody records into meanwhile."""
    with contextlib.ExitStack() as opened:
        try:
            file = opened.enter_context(path.open("rb"))
            _require_closed(file, path)
            require_version(file.read(_FIRST_LINE_BYTES), str(path))
            buffer = opened.enter_context(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        except OSError as error:
            raise BagError(f"{path}: cannot be read ({error.strerror})") from error
        yield buffer


def _require_closed(file, path: Path) -> None:
    """A recorder holds a lock on its bag, which ends with its process, however that ends."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        raise BagError(f"{path}: is being recorded now; stop the recorder first") from None
    except OSError:
        pass  # a file system without locks
