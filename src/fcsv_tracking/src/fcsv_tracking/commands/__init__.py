# SPDX-License-Identifier: Apache-2.0
"""Commands of fcsv_tracking for a desk: calibration of cameras and mounts, trajectories,
evaluation."""

from functools import partial

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs import commands

run = partial(commands.run, refused=(FcsvError, ValueError))
