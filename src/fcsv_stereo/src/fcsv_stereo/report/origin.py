# SPDX-License-Identifier: Apache-2.0
"""Where a map comes from: what stands at the top of its report."""

from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional, Tuple

from fcsv_geometry.config import read_yaml
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.version import VERSION
from fcsv_stereo.model import MapResult
from fcsv_stereo.report.naming import are_photographs, time_of


@dataclass(frozen=True)
class Origin:
    """Input, mission and seed of the simulation (empty, None: none is known), the command that was
    given (empty: it was no command), and when (Unix time, s; None: not known)."""

    source: str = ""
    mission: str = ""
    seed: Optional[int] = None
    command: str = ""
    made_s: Optional[float] = None

    @classmethod
    def of(cls, path: Path, command: str, made_s: float) -> "Origin":
        """Makes the origin of an input; mission and seed from its session.yaml, as far as that says
        them."""
        try:
            document = read_yaml(path / "session.yaml") if (path / "session.yaml").is_file() else {}
        except ConfigError:
            document = {}  # whoever reads the session says what is wrong with it
        document = document if isinstance(document, dict) else {}
        mission, simulation = (
            document.get(k) if isinstance(document.get(k), dict) else {} for k in _KEYS
        )
        return cls(str(path), str(mission.get("name", "")), simulation.get("seed"), command, made_s)

    def rows(self, result: MapResult) -> List[Tuple[str, str]]:
        """Gives the rows for the table at the top; what is not known is left out."""
        stamp = "" if are_photographs(result) else time_of(result.reference.stamp_s)
        found = [
            ("input", self.source),
            ("mission", self.mission),
            ("place", self._place(result)),
            ("reference picture taken", stamp),
            ("mapped", "" if self.made_s is None else time_of(self.made_s)),
            ("version", f"fcsv {VERSION}"),
            ("command", self.command),
        ]
        return [(name, value) for name, value in found if value]

    def _place(self, result: MapResult) -> str:
        if self.seed is not None:
            return f"simulated world, seed {self.seed}; coordinates of home"
        if not are_photographs(result):
            return "coordinates of home: where the reference's camera was when home was set"
        shift = ", ".join(f"{v:.0f}" for v in result.origin_m)
        return "coordinates of the photographs' model" + (
            f", near {shift}" if result.is_shifted else ""
        )


_KEYS = ("mission", "simulation")
