# SPDX-License-Identifier: Apache-2.0
"""The printed pattern of an AprilTag (family tag36h11)."""

import cv2
import numpy as np


def tag_bitmap(tag_id: int) -> np.ndarray:
    """10x10 float32, 1 white, 0 black: the 8x8 modules of the tag in a white border of one module.

    Row 0 is the top, column 0 the left as AprilRobotics' detector sees it; OpenCV's dictionary
    draws the same codes turned by half a turn. Raises ValueError for an id that the family lacks.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    if not 0 <= tag_id < len(dictionary.bytesList):
        raise ValueError(
            f"tag_id: {tag_id} is not in family tag36h11 (0..{len(dictionary.bytesList) - 1})"
        )
    drawn = cv2.aruco.generateImageMarker(dictionary, tag_id, 8, borderBits=1)
    return np.pad(np.rot90(drawn, 2) / 255.0, 1, constant_values=1.0).astype(np.float32)
