# SPDX-License-Identifier: Apache-2.0
"""Text files that other programs wrote."""

from pathlib import Path

from fcsv_stereo.errors import InputError


def text_of(path: Path) -> str:
    """All of it, with or without a byte order mark. Raises InputError that names the file where it
    is no UTF-8."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{path}, line {line}: is no text in UTF-8; save it as UTF-8") from error
