# SPDX-License-Identifier: Apache-2.0
"""A first map that nobody looks at: compiled kernels are loaded before the vehicles wait for
them."""

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import StereoError
from fcsv_stereo.model import (
    Axis,
    Configuration,
    ConfigurationInput,
    InputKind,
    MapInput,
    Method,
    Picture,
)

_SIZE = (160, 120)
_SHIFT_PX = 8


def warm_up(method: Method, options) -> None:
    """Run a method once on a small textured wall."""
    random = np.random.default_rng(1)
    wide = random.integers(0, 255, (_SIZE[1] // 4, (_SIZE[0] + _SHIFT_PX) // 4, 3), dtype=np.uint8)
    wide = wide.repeat(4, axis=0).repeat(4, axis=1)
    camera = PinholeCamera.from_fov(*_SIZE, np.radians(56.0))
    pictures = []
    for i in range(2):
        T_home_cam = transforms.transform(transforms.R_FLU_OPTICAL, np.array([0.0, -1.0 * i, 0.0]))
        image = np.ascontiguousarray(wide[:, i * _SHIFT_PX : i * _SHIFT_PX + _SIZE[0]])
        pictures.append(Picture(f"warm-up {i}", f"uav{i}", 0.0, image, camera, T_home_cam))
    pair = ConfigurationInput(Configuration(Axis.HORIZONTAL, 1.0), [pictures[0]], [pictures[1]])
    try:
        method.map(MapInput(InputKind.SESSION, [pair]), options)
    except StereoError:
        pass  # so small a picture may be refused: everything was loaded by then


if __name__ == "__main__":  # tools/setup.sh: compiled once, not while somebody waits for a map
    from fcsv_stereo.pipeline import DEFAULT_METHOD, METHODS

    warm_up(METHODS[DEFAULT_METHOD], METHODS[DEFAULT_METHOD].options())
