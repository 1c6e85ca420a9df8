# SPDX-License-Identifier: Apache-2.0
"""The vehicles' own cameras, as their camera_info has them, in place of the usual one."""

from dataclasses import replace
from typing import Dict

from fcsv_console.model.facts import CameraKnown
from fcsv_console.model.mission_file import Optics


class OwnOptics:
    """What ranges and errors are computed with; ``usual``: where a vehicle's camera was not
    heard."""

    def __init__(self, usual: Optics):
        self._usual = usual
        self._cameras: Dict[str, CameraKnown] = {}

    def tell(self, fact: CameraKnown) -> None:
        """A vehicle's camera_info was heard; the newest counts."""
        self._cameras[fact.vehicle] = fact

    def of(self, vehicle: str) -> Optics:
        """Gives the optics of one vehicle's camera."""
        c = self._cameras.get(vehicle)
        if c is None:
            return self._usual
        return replace(
            self._usual,
            focal_px=c.focal_px,
            focal_v_px=c.focal_v_px,
            width=c.width,
            height=c.height,
            heard_of=vehicle,
        )
