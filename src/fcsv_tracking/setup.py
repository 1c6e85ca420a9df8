# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

PACKAGES = [
    f"fcsv_tracking{p}" for p in ("", ".cameras", ".commands", ".evaluation", ".gimbal", ".mocap", ".mounts", ".ros")
]

setup(**generate_distutils_setup(packages=PACKAGES, package_dir={"": "src"}))
