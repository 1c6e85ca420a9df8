# SPDX-License-Identifier: Apache-2.0
"""Errors of the simulation."""

from fcsv_geometry.errors import FcsvError


class SimulationError(FcsvError):
    """Base of what goes wrong in the simulated world."""


class RenderError(SimulationError):
    """A picture cannot be made."""
