# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

PACKAGES = ["fcsv_sim", "fcsv_sim.autopilot", "fcsv_sim.demo", "fcsv_sim.render", "fcsv_sim.ros", "fcsv_sim.world"]

setup(**generate_distutils_setup(packages=PACKAGES, package_dir={"": "src"}))
