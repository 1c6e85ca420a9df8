# SPDX-License-Identifier: Apache-2.0
"""A rig's file, written anew."""

from dataclasses import asdict
from pathlib import Path

import yaml

from fcsv_tracking.tilting.rig import TiltingRig, load_rig


def write_rig(path: Path, rig: TiltingRig, note: str) -> TiltingRig:
    """The file with ``note`` as its first line; the rig as it reads back."""
    document = _plain(asdict(rig))
    for side in ("left", "right"):
        if document[side]["servo"] is None:
            del document[side]["servo"]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        f"# {note}\n" + yaml.safe_dump(document, sort_keys=False, default_flow_style=None)
    )
    return load_rig(path)


def _plain(value):
    """Lists for tuples, numbers rounded to what a file is read by."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return float(round(value, 9)) if isinstance(value, float) else value
