# SPDX-License-Identifier: Apache-2.0
"""Calibrating in flight: the column stands at a station, all but the last vehicle sway before the
ones behind them, and the calibration's node looks at the tags.

A tag that moves sideways tells the yaw (docs/design/decisions/0004-sway-while-calibrating.md).
Neighbours sway against each other, so that each tag stays in view.
"""

import math
from typing import Dict, List, Mapping, Optional

import numpy as np

from fcsv_control.mission.activities.activity import Activity, Progress
from fcsv_control.mission.activities.moving import Travel
from fcsv_control.mission.activities.stages import CALIBRATES
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.journey import go_to
from fcsv_geometry import transforms
from fcsv_geometry.missions.camera_places import in_home
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.streams.stream import Since

# of set-points to each side, behind which vehicles lag (0.8 m), of the first; of the next, against
# it:
SWAY_M = 1.0
_AGAINST = 0.7
_PERIOD_S = 8.0
_ORDER_EVERY_S = 0.2  # set-points: one that is lost on the radio is followed by the next
_STANDS_M, _STANDS_MPS, _STANDS_S = 0.3, 0.2, 1.0
_ATTEMPTS = 2
_ANSWER_S = 60.0  # the calibration ends itself after 40 s
#: What it takes (s) where tags come in at their usual rate: stand, look, stand.
USUAL_S = 20.0


def sway_places(T_home_view: np.ndarray, figure: Mapping[str, np.ndarray], at: float):
    """T_home_cam of each vehicle of a ``figure`` (T_view_cam, front first), at -1..1 of its
    sway."""
    shares = [(-_AGAINST if k % 2 else 1.0) for k in range(len(figure) - 1)] + [0.0]
    return {
        n: T_home_view @ transforms.from_xyz_yaw([0.0, at * share * SWAY_M, 0.0], 0.0) @ T
        for (n, T), share in zip(figure.items(), shares)
    }


class Calibrating(Activity):
    """One calibration at viewpoint ``view``. ``figure``: T_view_cam by vehicle, front first. It
    ``wants`` the service, and is told its answer; a calibration that is refused is left out with a
    note."""

    stage = CALIBRATES

    def __init__(
        self, mission: Mission, outbox: Outbox, figure: Mapping[str, np.ndarray], view: int
    ):
        super().__init__()
        self._mission, self._outbox, self._figure = mission, outbox, dict(figure)
        self._T_home_view = in_home(mission, view, np.eye(4))
        self._where = mission.viewpoints[view].station
        self._gathering: Optional[Travel] = Travel(
            mission,
            outbox,
            {n: T for n, T in self._places(0.0).items() if n != mission.reference},
            "the column",
            [mission.reference],
        )
        self._stands, self._began = Since(), Since()
        self._asked_s: Optional[float] = None
        self._answered = False
        self._attempts = 0
        self._ordered_s = -math.inf
        self.wants = False  # the service is to be called now

    def answered(self, done: bool, text: str) -> None:
        """How the service ended."""
        if self._asked_s is None:
            return
        self._asked_s, self._answered = None, done or self._attempts >= _ATTEMPTS
        self._ordered_s = -math.inf
        self._stands.end()
        if self._answered and not done:
            self._notes.append(f"not calibrated at {self._where}: {text}")

    def step(self, snapshot: Snapshot, guided) -> Progress:
        """Gather, stand, sway until the service answers, stand."""
        self.detail = f"the column calibrates at {self._where}"
        if self._gathering is not None:
            if self._gathering.step(snapshot, guided) is Progress.UNDER_WAY:
                return Progress.UNDER_WAY
            self._gathering = None
        if self._asked_s is not None:
            self._sway(snapshot)
            return Progress.UNDER_WAY
        self._go(snapshot, self._places(0.0))
        late = self._began.lasts_s(snapshot.now_s) > self._mission.settle.timeout_s
        if self._stands.lasts_s(snapshot.now_s, self._stand(snapshot)) < _STANDS_S and not late:
            return Progress.UNDER_WAY
        self._began.end()
        if self._answered:
            return Progress.DONE
        self._asked_s, self._attempts, self.wants = snapshot.now_s, self._attempts + 1, True
        return Progress.UNDER_WAY

    def skip(self) -> bool:
        self._notes.append(f"not calibrated at {self._where}: left out by the operator")
        return True

    def _sway(self, snapshot: Snapshot) -> None:
        since_s = snapshot.now_s - self._asked_s
        self._go(snapshot, self._places(math.sin(2.0 * math.pi * since_s / _PERIOD_S)))
        if since_s > _ANSWER_S:
            self.answered(False, "its service does not answer")

    def _places(self, at: float) -> Dict[str, np.ndarray]:
        return sway_places(self._T_home_view, self._figure, at)

    def _go(self, snapshot: Snapshot, places: Mapping[str, np.ndarray]) -> None:
        if snapshot.now_s - self._ordered_s >= _ORDER_EVERY_S - 1e-6:
            self._ordered_s = snapshot.now_s
            for name, T_home_cam in places.items():
                go_to(self._outbox, snapshot, name, T_home_cam)

    def _stand(self, snapshot: Snapshot) -> bool:
        off: List[bool] = [
            float(np.linalg.norm(snapshot.p_home_cam(n) - T[:3, 3])) > _STANDS_M
            or snapshot.vehicles[n].speed_mps > _STANDS_MPS
            for n, T in self._places(0.0).items()
        ]
        return not any(off)
