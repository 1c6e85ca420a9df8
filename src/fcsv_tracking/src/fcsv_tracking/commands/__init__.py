# SPDX-License-Identifier: Apache-2.0
"""What ``rosrun fcsv_tracking`` runs on a desk: calibration of cameras and mounts, trajectories, evaluation."""

from functools import partial

from fcsv_geometry import commands
from fcsv_geometry.errors import FcsvError

run = partial(commands.run, refused=(FcsvError, ValueError))
