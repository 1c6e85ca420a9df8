# SPDX-License-Identifier: Apache-2.0
from distutils.core import setup
from pathlib import Path

from catkin_pkg.python_setup import generate_distutils_setup

SOURCES = Path(__file__).resolve().parent / "src"
PACKAGES = sorted(
    ".".join(p.parent.relative_to(SOURCES).parts) for p in SOURCES.rglob("__init__.py")
)

setup(
    **generate_distutils_setup(
        packages=PACKAGES,
        package_dir={"": "src"},
        package_data={"fcsv_guidance.ground": ["*.json"]},
    )
)
