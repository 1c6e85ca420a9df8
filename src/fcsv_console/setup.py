# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

PARTS = ("model", "model.facts", "children", "ros", "terminal", "qt")
PACKAGES = ["fcsv_console", *(f"fcsv_console.{name}" for name in PARTS)]

setup(**generate_distutils_setup(packages=PACKAGES, package_dir={"": "src"}))
