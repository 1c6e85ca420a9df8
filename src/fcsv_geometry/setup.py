# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

PACKAGES = ["fcsv_geometry", "fcsv_geometry.bags", "fcsv_geometry.ros"]

DATA = {"fcsv_geometry.bags": ["definitions/*.msg"]}

setup(**generate_distutils_setup(packages=PACKAGES, package_dir={"": "src"}, package_data=DATA))
