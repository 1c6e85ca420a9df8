# SPDX-License-Identifier: Apache-2.0
"""The user's own camera in a demo: its calibration file, and whether it can be simulated and
flown."""

from dataclasses import dataclass
from pathlib import Path
from typing import Mapping

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.camera_file import read_camera
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_sim.errors import SimulationError
from fcsv_sim.render.lens import require_can_be_rendered
from fcsv_sim.sensors.camera import CameraParameters

#: Of 10 simulated pictures the detector found the tag in all at 11.2 px, in one at 9.2 px
#: (2026-11-28).
_LEAST_TAG_PX = 12.0
_RATE_HZ = 5.5  # of pictures as large as those of the usual camera: as camera_rate_hz of uav.launch


@dataclass(frozen=True)
class OwnCamera:
    """``rate_hz``: at which its pictures take as much of a core as the usual camera's."""

    file: Path
    name: str
    camera: PinholeCamera

    @property
    def rate_hz(self) -> float:
        usual = CameraParameters().model
        share = usual.width * usual.height / (self.camera.width * self.camera.height)
        return round(_RATE_HZ * min(1.0, share), 2)

    @property
    def words(self) -> str:
        """What all vehicles carry."""
        c = self.camera
        return (
            f"all vehicles carry camera '{self.name}' of {self.file}: {c.width}x{c.height}, f {c.fx:.0f} px, "
            f"{self.rate_hz:g} pictures a second"
        )


def own_camera(path: str, mission: Mission, vehicles: Mapping[str, VehicleGeometry]) -> OwnCamera:
    """The camera of a calibration file, for all these vehicles in the mission's column.

    Raises SimulationError that names the file and what cannot be simulated or flown, and says what
    to do.
    """
    try:
        name, camera = read_camera(Path(path))
        require_can_be_rendered(camera)
    except FcsvError as error:
        words = str(error)
        raise SimulationError(
            f"--camera {words if words.startswith(path) else f'{path}: {words}'}"
        ) from error
    for vehicle in list(vehicles.values())[:-1]:
        _require_tag(path, camera, vehicle, mission.column_spacing_m)
    return OwnCamera(Path(path).resolve(), name, camera)


def _require_tag(
    path: str, camera: PinholeCamera, front: VehicleGeometry, spacing_m: float
) -> None:
    """The tag of the vehicle in front must be large enough in the picture to calibrate by."""
    # of the spacing, what camera and tag are nearer
    between_m = front.camera.xyz_m[0] - front.tag.xyz_m[0]
    px_m = min(camera.fx, camera.fy) * front.tag_size_m
    tag_px = px_m / (spacing_m - between_m)
    if tag_px < _LEAST_TAG_PX:
        raise SimulationError(
            f"--camera {path}: the tag of {front.name} ({front.tag_size_m:g} m) is {tag_px:.0f} px large at "
            f"column_spacing_m {spacing_m:g}, {_LEAST_TAG_PX:.0f} px are needed to calibrate: take a spacing of up to "
            f"{px_m / _LEAST_TAG_PX + between_m:.1f} m in the mission, or a longer focal length"
        )
