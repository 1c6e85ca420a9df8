# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

setup(**generate_distutils_setup(packages=["fcsv_sim", "fcsv_sim.ros"], package_dir={"": "src"}))
