# SPDX-License-Identifier: Apache-2.0
"""Rectified pairs with truth: Motorcycle, and pairs drawn in the bench's worlds."""

from dataclasses import dataclass
from typing import List, Optional

import numpy as np

from bench.photographs import motorcycle
from bench.scenes import T_WORLD_HOME, SceneName, camera_in
from fcsv_geometry import transforms
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput, Picture, PosePrior

BASELINE_M = 4.0
PRIOR = PosePrior(np.radians(0.01), 0.0, 0.001)  # of a calibrated rig; position over baseline


@dataclass(frozen=True)
class RectifiedCase:
    """``left`` and ``right`` have their true poses, and their rows correspond. ``true_depth`` is of
    ``left`` (H,W): m, not finite where there is none or it is not known. ``kind`` as in MapInput.
    """

    name: str
    left: Picture
    right: Picture
    true_depth: np.ndarray
    kind: str = "session"

    @property
    def focal_baseline_px_m(self) -> float:
        """Depth (m) times shift from infinity (px)."""
        apart = self.left.T_home_cam[:3, 3] - self.right.T_home_cam[:3, 3]
        return self.left.camera.fx * float(np.linalg.norm(apart))

    @property
    def doffs_px(self) -> float:
        """Minus the disparity of infinity, as Middlebury calls it."""
        return self.right.camera.cx - self.left.camera.cx

    def disparity(self, depth: np.ndarray) -> np.ndarray:
        """Column in the left picture less column in the right one (px) at a depth (m)."""
        return self.focal_baseline_px_m / depth - self.doffs_px

    def given(self) -> MapInput:
        """For a method: the pair with its poses known as those of a calibrated rig are."""
        baseline_m = self.focal_baseline_px_m / self.left.camera.fx
        configuration = Configuration("horizontal", baseline_m, 0.0, self.right.name)
        pair = ConfigurationInput(configuration, [self.left], [self.right])
        return MapInput(self.kind, [pair], prior=PRIOR)


def rectified_cases(names: List[SceneName]) -> List[RectifiedCase]:
    """Motorcycle, where it lies beside the checkout, and a pair of each scene."""
    real = motorcycle_pair()
    return [*([real] if real else []), *(drawn(name) for name in names)]


def motorcycle_pair() -> Optional[RectifiedCase]:
    """None where it is not there."""
    case = motorcycle()
    if case is None:
        return None
    (c,) = case.given.configurations
    left, right, kind = c.references[0], c.others[0], case.given.kind.value
    return RectifiedCase("Motorcycle", left, right, case.true_depth, kind)


def drawn(name: SceneName, size=(640, 480)) -> RectifiedCase:
    """A pair of a scene, rectified as it is drawn: parallel cameras, 4 m apart along the rows."""
    camera = camera_in(name, size)

    def take(number: int, y_m: float):
        T_home_body = transforms.from_xyz_yaw([0.0, y_m, 0.0], 0.0)
        shot = camera.shoot(float(number), T_WORLD_HOME @ T_home_body)
        T_home_cam = transforms.invert(T_WORLD_HOME) @ shot.T_world_cam
        uav = f"uav{number}"
        return Picture(uav, uav, 0.0, shot.rgb, camera.model, T_home_cam), shot.depth

    (left, depth), (right, _) = take(1, 0.0), take(2, -BASELINE_M)
    return RectifiedCase(str(name), left, right, depth)
