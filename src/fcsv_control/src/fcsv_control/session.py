# SPDX-License-Identifier: Apache-2.0
"""session.yaml: what belongs together."""

import dataclasses
from pathlib import Path
from typing import Optional, Sequence

import yaml

from fcsv_control.mission.config import load_mission


def write_session(folder, vehicles: Sequence[str], mission_file, created: str, seed: Optional[int] = None) -> Path:
    """Write (or overwrite) session.yaml in ``folder``; raises ConfigError where the mission cannot be read."""
    mission = load_mission(mission_file)
    document = {
        "version": 1,
        "created": created,
        "reference": mission.reference,
        "vehicles": list(vehicles),
        "bags": {**{v: f"{v}.bag" for v in vehicles}, "control": "control.bag"},
        "mission": dataclasses.asdict(mission),
    }
    if seed is not None:
        document["simulation"] = {"seed": seed}
    path = Path(folder) / "session.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path
