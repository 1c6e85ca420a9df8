# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

PACKAGES = ["fcsv_console", *(f"fcsv_console.{name}" for name in ("model", "ros", "terminal", "qt"))]

setup(**generate_distutils_setup(packages=PACKAGES, package_dir={"": "src"}))
