# SPDX-License-Identifier: Apache-2.0
"""Where the workspace's launch and configuration files are: the package whose folders are the
top-level config/, launch/ and rviz/."""

from pathlib import Path
from typing import Optional

from fcsv_geometry.errors import ConfigError

_PACKAGE = "fcsv_bringup"


def find_bringup() -> Optional[Path]:
    """The package's folder; None without ROS, or where this shell does not know the workspace."""
    try:
        import rospkg
    except ImportError:
        return None
    try:
        return Path(rospkg.RosPack().get_path(_PACKAGE))
    except rospkg.ResourceNotFound:
        return None


def bringup() -> Path:
    """The package's folder. Raises ConfigError where there is none."""
    folder = find_bringup()
    if folder is None:
        raise ConfigError(
            f"the package {_PACKAGE} is not found: this shell does not know the workspace; "
            "source its devel/setup.bash"
        )
    return folder
