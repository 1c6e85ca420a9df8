# SPDX-License-Identifier: Apache-2.0
"""What ``rosrun fcsv_tracking`` runs on a desk: calibration of cameras and mounts, trajectories, evaluation."""

from functools import partial

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs import commands

run = partial(commands.run, refused=(FcsvError, ValueError))
