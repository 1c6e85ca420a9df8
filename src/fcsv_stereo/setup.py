# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

PARTS = ("joint", "planning", "products", "refinement", "report", "ros", "thesis")
PACKAGES = ["fcsv_stereo", *(f"fcsv_stereo.{part}" for part in PARTS)]

setup(**generate_distutils_setup(packages=PACKAGES, package_dir={"": "src"}))
