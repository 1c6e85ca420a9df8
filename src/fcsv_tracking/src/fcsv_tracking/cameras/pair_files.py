# SPDX-License-Identifier: Apache-2.0
"""Both calibration files of a stereo pair, with its rectification."""

from pathlib import Path

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.camera_file import write_camera
from fcsv_tracking.cameras.stereo import StereoCalibration


def write_pair(
    folder: Path, left: PinholeCamera, right: PinholeCamera, stereo: StereoCalibration
) -> None:
    """left.yaml and right.yaml with the rectification of both (cv2.stereoRectify, whole pictures
    kept valid)."""
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        left.K,
        np.array(left.distortion),
        right.K,
        np.array(right.distortion),
        (left.width, left.height),
        stereo.T_right_left[:3, :3],
        stereo.T_right_left[:3, 3],
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )
    write_camera(folder / "left.yaml", "left", left, R1, P1)
    write_camera(folder / "right.yaml", "right", right, R2, P2)
