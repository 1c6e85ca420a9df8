# SPDX-License-Identifier: Apache-2.0
"""Where tasks lead, as poses and in words."""

from typing import Dict, Mapping, Sequence, Tuple

import numpy as np

from fcsv_control.mission.plans.task_list import Task
from fcsv_geometry.missions.camera_places import in_home, mover_place
from fcsv_geometry.missions.mission import Mission


class Destinations:
    """``parked`` is each vehicle's T_home_cam in the column, level, as it stands at home."""

    def __init__(self, mission: Mission, parked: Mapping[str, np.ndarray]):
        self._mission, self._parked = mission, parked

    def place(self, task: Task) -> Tuple[np.ndarray, str]:
        """T_home_cam, and its name."""
        if task.index is None:
            T_home_cam = in_home(self._mission, task.view, self._parked[task.vehicle])
            return T_home_cam, "its place in the column"
        return mover_place(self._mission, task.index), self._mission.title(task.index)

    def places(self, moment: Sequence[Task]) -> Dict[str, np.ndarray]:
        """T_home_cam by vehicle of tasks at once."""
        return {t.vehicle: self.place(t)[0] for t in moment}

    def in_words(self, moment: Sequence[Task]) -> Tuple[str, str]:
        """(who, where to)."""
        if moment[0].changes:
            return "the column", self._mission.viewpoints[moment[0].view].title
        names = [self.place(t)[1] for t in moment]
        where = (
            "their places in the column"
            if len(moment) > 1 and moment[0].index is None
            else " and ".join(names)
        )
        return " and ".join(t.vehicle for t in moment), where
