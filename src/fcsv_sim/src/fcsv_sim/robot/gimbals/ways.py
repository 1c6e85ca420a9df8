# SPDX-License-Identifier: Apache-2.0
"""Ways of a column of two vehicles around a robot that stands, on which its gimbals see both all the
time: which order of places is shortest, and through which places it leads."""

from itertools import permutations
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from fcsv_control.mission.ways.formation import formation_legs
from fcsv_geometry import transforms
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_sim.robot.gimbals.survey import GimbalSurvey
from fcsv_tracking.gimbal.reach import gimbal_problem

_FAR_M = 3.5  # level, of vehicles that move: tags are small beyond, and seen for too short
_SAMPLE_M, _SAMPLE_RAD = 0.15, np.radians(6.0)  # of a leg
_REACH_M, _STEP_M, _HEADINGS = 4.0, 0.4, 12  # of the lattice of places around the robot
_TURN_M = 0.4  # way that a turn from one heading to the next counts as


class GimbalWays:
    """``T_world_ground`` 4x4, level, of the robot; ``beside_m``: how far right of the reference the
    other flies. Places are T_world_view 4x4 of viewpoints."""

    def __init__(
        self,
        survey: GimbalSurvey,
        T_world_ground: np.ndarray,
        beside_m: float,
        flight: FlightBounds,
    ):
        self._gimbals, self._flight = survey.gimbals, flight
        self._T_ground_world = transforms.invert(T_world_ground)
        asides_m = np.array([[0.0, 0.0, 0.0], [0.0, -beside_m, 0.0]])
        self._T_view_body = [
            transforms.transform(np.eye(3), aside - survey.T_body_cam[:3, 3]) for aside in asides_m
        ]
        self._figure = {
            str(k): transforms.transform(np.eye(3), aside) @ T_HOME_CAM_AT_HOME
            for k, aside in enumerate(asides_m)
        }
        self._lattices: Dict[float, _Lattice] = {}

    def sees(self, T_world_view: np.ndarray) -> bool:
        """Whether both gimbals see their vehicles of a column there well."""
        T_ground_view = self._T_ground_world @ T_world_view
        bodies = [T_ground_view @ T for T in self._T_view_body]
        if max(float(np.hypot(*T[:2, 3])) for T in bodies) > _FAR_M:
            return False
        return not any(map(gimbal_problem, self._gimbals, bodies))

    def keeps_sight(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether they do all the way from place to place."""
        for leg in formation_legs(a, b, self._figure, self._flight):
            long = max(
                float(np.linalg.norm(leg.shift_m)) / _SAMPLE_M, abs(leg.turn_rad) / _SAMPLE_RAD
            )
            shares = np.linspace(0.0, 1.0, int(np.ceil(long)) + 1)
            if not all(self.sees(leg.frame(share)) for share in shares):
                return False
        return True

    def leads(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether some way seems to lead from place to place, and the second is seen."""
        return self.sees(b) and self._lattice(b).joins(a, b)

    def ordered(self, places: Sequence[np.ndarray]) -> Optional[List[List[np.ndarray]]]:
        """The shortest way from the first of ``places`` to the last, over as many of the others as one
        way joins: for each that follows, in order, the places through which it leads, itself last.
        None where it joins no other."""
        n = len(places)
        ways: Dict[Tuple[int, int], List[np.ndarray]] = {}
        length_m = np.full((n, n), np.inf)
        for i in range(n - 1):
            for j in range(1, n):
                way = self._way(places[i], places[j]) if i != j else None
                if way is not None:
                    ways[i, j] = way
                    points_m = np.array([places[i][:3, 3], *(T[:3, 3] for T in way)])
                    steps_m = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
                    length_m[i, j] = steps_m.sum() + _TURN_M * len(way)
        for count in range(n - 2, 0, -1):
            others = permutations(range(1, n - 1), count)
            orders = np.array([(0, *order, n - 1) for order in others])
            total_m = length_m[orders[:, :-1], orders[:, 1:]].sum(1)
            best = orders[int(np.argmin(total_m))]
            if np.isfinite(total_m.min()):
                return [ways[i, j] for i, j in zip(best[:-1], best[1:])]
        return None

    def _way(self, a: np.ndarray, b: np.ndarray) -> Optional[List[np.ndarray]]:
        """The places between two, and the second; straight where that keeps sight."""
        if self.keeps_sight(a, b):
            return [b]
        way = self._lattice(b).way(a, b)
        if way is None:
            return None
        kept, at = [], 0
        while at < len(way) - 1:
            further = range(len(way) - 1, at, -1)
            at = next((k for k in further if self.keeps_sight(way[at], way[k])), -1)
            if at < 0:
                return None
            kept.append(way[at])
        return kept

    def _lattice(self, T_world_view: np.ndarray) -> "_Lattice":
        """The one at the height of a place."""
        z_m = float(T_world_view[2, 3])
        if z_m not in self._lattices:
            self._lattices[z_m] = _Lattice(self, transforms.invert(self._T_ground_world), z_m)
        return self._lattices[z_m]


class _Lattice:
    """Places around the robot at one height, at which its gimbals see the column, and which are
    neighbours."""

    def __init__(self, ways: GimbalWays, T_world_ground: np.ndarray, z_m: float):
        axis = np.arange(-_REACH_M, _REACH_M + 1e-9, _STEP_M)
        x, y = T_world_ground[:2, 3]
        shape = len(axis), len(axis), _HEADINGS
        turn = 2 * np.pi / _HEADINGS
        self._places = [
            transforms.from_xyz_yaw([x + axis[i], y + axis[j], z_m], k * turn)
            for i, j, k in np.ndindex(shape)
        ]
        self._seen = np.array([ways.sees(T) for T in self._places])
        self._at = np.array([(*T[:2, 3], transforms.yaw(T)) for T in self._places])
        index = np.arange(len(self._places)).reshape(shape)
        pairs = [
            (index[:-1], index[1:], _STEP_M),
            (index[:, :-1], index[:, 1:], _STEP_M),
            (index[:-1, :-1], index[1:, 1:], np.sqrt(2) * _STEP_M),
            (index[:-1, 1:], index[1:, :-1], np.sqrt(2) * _STEP_M),
            (index, np.roll(index, -1, axis=2), _TURN_M),
        ]
        rows, columns, lengths = (
            np.concatenate([np.broadcast_to(part[m], part[0].shape).ravel() for part in pairs])
            for m in range(3)
        )
        able = self._seen[rows] & self._seen[columns]
        edges = lengths[able], (rows[able], columns[able])
        self._graph = coo_matrix(edges, (len(self._places),) * 2).tocsr()
        self._parts = connected_components(self._graph, directed=False)[1]

    def way(self, a: np.ndarray, b: np.ndarray) -> Optional[List[np.ndarray]]:
        """Places from ``a`` to ``b``, both included; None where there are none."""
        if not self.joins(a, b):
            return None
        first, nodes = self._nearest(a), [self._nearest(b)]
        _, before = dijkstra(self._graph, directed=False, indices=first, return_predecessors=True)
        while nodes[-1] != first:
            nodes.append(int(before[nodes[-1]]))
        return [a, *(self._places[i] for i in nodes[::-1]), b]

    def joins(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether places lead from ``a`` to ``b``."""
        first, last = self._nearest(a), self._nearest(b)
        return first is not None and last is not None and self._parts[first] == self._parts[last]

    def _nearest(self, T_world_view: np.ndarray) -> Optional[int]:
        off_m = np.hypot(*(self._at[:, :2] - T_world_view[:2, 3]).T)
        off_rad = np.abs(np.angle(np.exp(1j * (self._at[:, 2] - transforms.yaw(T_world_view)))))
        far = np.where(self._seen, off_m + off_rad, np.inf)
        return int(np.argmin(far)) if np.isfinite(far).any() else None
