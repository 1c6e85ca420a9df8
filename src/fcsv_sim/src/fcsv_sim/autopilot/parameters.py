# SPDX-License-Identifier: Apache-2.0
"""Parameters that matter to a companion, with ArduCopter's defaults as set up for external navigation."""

from typing import Dict, Tuple

REAL32, INT8, INT16, INT32 = 9, 2, 4, 6  # MAV_PARAM_TYPE
#: name: (value, type)
DEFAULTS: Dict[str, Tuple[float, int]] = {
    "SYSID_THISMAV": (1, INT16),
    "SYSID_MYGCS": (255, INT16),
    "SYSID_ENFORCE": (0, INT8),
    "FS_GCS_ENABLE": (0, INT8),
    "FS_EKF_ACTION": (1, INT8),
    "FS_EKF_THRESH": (0.8, REAL32),
    "FS_THR_ENABLE": (0, INT8),
    "AHRS_EKF_TYPE": (3, INT8),
    "EK3_ENABLE": (1, INT8),
    "EK3_SRC1_POSXY": (6, INT8),
    "EK3_SRC1_POSZ": (6, INT8),
    "EK3_SRC1_VELXY": (6, INT8),
    "EK3_SRC1_VELZ": (6, INT8),
    "EK3_SRC1_YAW": (6, INT8),
    "VISO_TYPE": (2, INT8),
    "VISO_ORIENT": (0, INT8),
    "VISO_POS_X": (0, REAL32),
    "VISO_POS_Y": (0, REAL32),
    "VISO_POS_Z": (0, REAL32),
    "VISO_POS_M_NSE": (0.2, REAL32),
    "VISO_YAW_M_NSE": (0.2, REAL32),
    "COMPASS_USE": (0, INT8),
    "GPS_TYPE": (0, INT8),
    "ARMING_CHECK": (1, INT32),
    "DISARM_DELAY": (10, INT8),
    "GUID_TIMEOUT": (3, REAL32),
    "GUID_OPTIONS": (0, INT32),
    "LAND_SPEED": (50, INT16),
    "WPNAV_SPEED": (500, REAL32),
    "FLTMODE_CH": (5, INT8),
}
