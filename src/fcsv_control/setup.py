# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

PACKAGES = ["fcsv_control", "fcsv_control.flight", "fcsv_control.mission", "fcsv_control.ros"]

setup(**generate_distutils_setup(packages=PACKAGES, package_dir={"": "src"}))
