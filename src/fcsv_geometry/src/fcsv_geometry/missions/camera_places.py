# SPDX-License-Identifier: Apache-2.0
"""Where a mission's configurations have their cameras: in the frame of their viewpoint, and in
home."""

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.missions.configuration import StereoConfiguration
from fcsv_geometry.missions.mission import Mission

#: T_home_cam of the reference: position zero, level, looking along home's x.
T_HOME_CAM_AT_HOME = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


def camera_place(configuration: StereoConfiguration) -> np.ndarray:
    """T_home_cam of the moving camera: right of the reference (horizontal) or above it (vertical);
    of a sweep where it begins.

    >>> camera_place(StereoConfiguration("horizontal", 4.0))[:3, 3].tolist()
    [0.0, -4.0, 0.0]
    >>> camera_place(StereoConfiguration("vertical", 5.0))[:3, 3].tolist()
    [0.0, 0.0, 5.0]
    """
    if configuration.sweep is not None:
        return sweep_place(configuration, 0.0)
    b = configuration.baseline_m
    p = [0.0, -b, 0.0] if configuration.axis == "horizontal" else [0.0, 0.0, b]
    return transforms.from_xyz_yaw(p, configuration.tilt_rad) @ T_HOME_CAM_AT_HOME


def sweep_place(configuration: StereoConfiguration, share: float) -> np.ndarray:
    """T_home_cam of the moving camera after a share 0..1 of a configuration's sweep."""
    place_m = configuration.sweep.place_m(share)
    return transforms.from_xyz_yaw(place_m, configuration.tilt_rad) @ T_HOME_CAM_AT_HOME


def last_place(configuration: StereoConfiguration) -> np.ndarray:
    """T_home_cam of the moving camera when the configuration is done."""
    return (
        camera_place(configuration)
        if configuration.sweep is None
        else sweep_place(configuration, 1.0)
    )


def in_home(mission: Mission, view: int, T_view_cam: np.ndarray) -> np.ndarray:
    """T_home_cam of a camera whose place is known in the frame of a viewpoint."""
    return T_view_cam if view == 0 else mission.viewpoints[view].T_home_view @ T_view_cam


def mover_place(mission: Mission, index: int) -> np.ndarray:
    """T_home_cam of the moving camera of configuration ``index``; of a sweep where it begins."""
    configuration = mission.configurations[index]
    return in_home(mission, configuration.view, camera_place(configuration))


def mover_end(mission: Mission, index: int) -> np.ndarray:
    """T_home_cam of the moving camera when configuration ``index`` is done."""
    configuration = mission.configurations[index]
    return in_home(mission, configuration.view, last_place(configuration))


def reference_place(mission: Mission, view: int) -> np.ndarray:
    """T_home_cam of the reference while it holds at a viewpoint."""
    return in_home(mission, view, T_HOME_CAM_AT_HOME)
