# SPDX-License-Identifier: Apache-2.0
"""Equation 4.1 of the thesis in T_a_b notation: the relative pose of two vehicles that two gimbal
cameras see.

G ground robot, C1, C2 the gimbal cameras, D1, D2 the vehicles. As printed, with R_Cn = R_G_Cn, T_Cn
= p_G_Cn and R_Dn, T_An the vehicle as its camera sees it (R_Cn_Dn, p_Cn_Dn):

    T_1->2 = R_D1 (T_C1->C2 + R_C2 T_A2 - R_C1 T_A1)          R_1->2 = R_D1' R_C1' R_C2 R_D2

What was corrected. The rotation is right. The bracket is the way from vehicle 1 to vehicle 2 in G;
to have it in vehicle 1's axes it must be turned by R_D1_G = R_D1' R_C1', not by R_D1: the printed
one is neither transposed nor does it leave G by way of the camera. With whole transforms both are
one product; tests/fcsv_tracking/test_gimbal_geometry.py proves it.
"""

import numpy as np

from fcsv_geometry import transforms


def relative_pose(
    T_G_C1: np.ndarray, T_C1_D1: np.ndarray, T_G_C2: np.ndarray, T_C2_D2: np.ndarray
) -> np.ndarray:
    """T_D1_D2 (4,4) from each gimbal camera's place and what it sees (4.1, corrected)."""
    return transforms.invert(T_G_C1 @ T_C1_D1) @ (T_G_C2 @ T_C2_D2)


def baseline_m(T_D1_D2: np.ndarray) -> float:
    """4.2: the distance between the two.

    >>> baseline_m(transforms.from_xyz_rpy([0.0, 3.0, 4.0], [0.1, 0.2, 0.3]))
    5.0
    """
    return float(np.linalg.norm(T_D1_D2[:3, 3]))
