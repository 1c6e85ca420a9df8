# SPDX-License-Identifier: Apache-2.0
"""A folder that a command writes: all of it, or none."""

import shutil
import tempfile
from pathlib import Path
from typing import Callable

from fcsv_geometry.programs.writing import in_words
from fcsv_stereo.errors import OutputError


def check_new(out: Path) -> None:
    """OUT is not there, or an empty folder. Raises OutputError."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise OutputError(f"{out}: is not empty; name a new folder")


class StagedFolder:
    """A folder beside OUT that takes its place when everything is in it, and leaves no trace
    otherwise.

    ``check`` raises OutputError where OUT must stay as it is.
    """

    def __init__(self, out: Path, check: Callable[[Path], None] = check_new):
        check(out)
        # a link to a folder, and ".", cannot be replaced: what they stand for can
        self._out, self._check = out.resolve() if out.is_dir() else out, check
        beside = self._out.absolute().parent
        try:
            beside.mkdir(parents=True, exist_ok=True)
            self.folder = Path(tempfile.mkdtemp(prefix=f".{self._out.name}.", dir=beside))
        except OSError as error:
            raise OutputError(in_words(error, out.parent)) from error

    def __enter__(self) -> "StagedFolder":
        return self

    def __exit__(self, kind, _value, _traceback) -> None:
        try:
            if kind is None:
                self._check(self._out)  # what came there meanwhile stays
                self.folder.chmod(0o755)
                if self._out.exists():
                    shutil.rmtree(self._out)
                self.folder.rename(self._out)
        finally:
            shutil.rmtree(self.folder, ignore_errors=True)
