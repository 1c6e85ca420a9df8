# SPDX-License-Identifier: Apache-2.0
"""Files of the workspace's configuration, by name."""

from pathlib import Path

from fcsv_geometry.programs.workspace import bringup
from fcsv_sim.errors import SimulationError


def vehicles_folder() -> Path:
    """config/vehicles."""
    return bringup() / "config" / "vehicles"


def mission_file(wished: str) -> Path:
    """A mission's file: as given, or by its name in config/missions. Raises SimulationError where
    there is none."""
    folder, path = bringup() / "config" / "missions", Path(wished)
    if not path.suffix:
        path = folder / f"{wished}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.yaml")))
        raise SimulationError(f"no mission '{wished}': give a file or one of {known}")
    return path.resolve()


def robot_file(name: str) -> Path:
    """config/robots/NAME.yaml."""
    return bringup() / "config" / "robots" / f"{name}.yaml"
