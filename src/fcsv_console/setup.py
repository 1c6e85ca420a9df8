# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

PACKAGES = ["fcsv_console", "fcsv_console.model", "fcsv_console.ros", "fcsv_console.terminal"]

setup(**generate_distutils_setup(packages=PACKAGES, package_dir={"": "src"}))
