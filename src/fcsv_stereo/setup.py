# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

PACKAGES = ["fcsv_stereo", "fcsv_stereo.report", "fcsv_stereo.ros"]

setup(**generate_distutils_setup(packages=PACKAGES, package_dir={"": "src"}))
