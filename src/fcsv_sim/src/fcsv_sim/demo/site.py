# SPDX-License-Identifier: Apache-2.0
"""Where a pair of Tellos flies before a tracker on the ground (world frame, m), and the tracker's
launch file."""

from dataclasses import dataclass, field
from typing import Dict, List, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.missions.camera_places import camera_place
from fcsv_geometry.missions.mission import Mission


@dataclass(frozen=True)
class PairSite:
    """The tracker's launch file, and where they take off and line up before it."""

    launch_file: str
    launch_args: Dict[str, object] = field(default_factory=dict)
    reference_xy_m: Tuple[float, float] = (3.0, 0.5)
    beside_m: float = 1.1  # to the right of the reference the others line up
    # how far all sway sideways until the tracker knows their headings; nought: it needs no motion
    sway_m: float = 0.0
    # of the world's x in the tracker's frame: vehicles line up along it
    heading_deg: float = 0.0
    # the tracker starts once the vehicles hover before it: gimbals that search earlier turn away
    late: bool = False

    def line_up(self, mission: Mission, vehicles: Sequence[str]) -> Dict[str, np.ndarray]:
        """T_world_body of each vehicle before home is set: side by side, looking along the world's
        x."""
        ordered = [mission.reference, *(v for v in vehicles if v != mission.reference)]
        return {n: self._place(k, mission.home_height_m) for k, n in enumerate(ordered)}

    def starts(self, mission: Mission, vehicles: Sequence[str]) -> Dict[str, List[float]]:
        """x, y, z, yaw on the ground below."""
        return {n: [*T[:2, 3], 0.0, 0.0] for n, T in self.line_up(mission, vehicles).items()}

    def expected_body(
        self, mission: Mission, index: int, vehicle: str, vehicles: Sequence[str]
    ) -> np.ndarray:
        """T_world_body that configuration ``index`` will ask of a vehicle, were home set exactly at
        the line-up."""
        T = self.line_up(mission, vehicles)[mission.reference]
        if vehicle != mission.mover(index, vehicles):
            return T
        place = camera_place(mission.configurations[index])
        return transforms.transform(T[:3, :3], T[:3, 3] + place[:3, 3])

    def _place(self, number: int, height_m: float) -> np.ndarray:
        x, y = self.reference_xy_m
        return transforms.from_xyz_yaw([x, y - number * self.beside_m, height_m], 0.0)
