# SPDX-License-Identifier: Apache-2.0
"""What is fixed on a vehicle: where its camera, tracking camera and tag sit, and which tag it
carries."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Dict, Iterable, Tuple

import numpy as np

from fcsv_geometry import config, transforms

Vector3 = Tuple[float, float, float]
MOST_TAG_ID = 586  # of family tag36h11


@dataclass(frozen=True)
class Mount:
    """Pose of a part in the body frame: metres, and degrees about fixed x, y, z (a person types
    them)."""

    xyz_m: Vector3  # in the body frame: x forward, y left, z up
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw about fixed x, y, z

    @property
    def T_body_part(self) -> np.ndarray:
        return _mounted(self).copy()

    @property
    def T_body_tag(self) -> np.ndarray:
        """The same of a tag whose printed face looks along x, as the AprilRobotics detector has its
        frame: seen from its front x right, y down, z into the tag."""
        R_flu_tag = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        return self.T_body_part @ transforms.transform(R_flu_tag, np.zeros(3))


@lru_cache(maxsize=None)
def _mounted(mount: Mount) -> np.ndarray:
    return transforms.from_xyz_rpy(mount.xyz_m, np.radians(mount.rpy_deg))


@dataclass(frozen=True)
class VehicleGeometry:
    """One vehicle, as in config/vehicles/NAME.yaml.

    ``camera`` and ``tag`` are given forward-left-up: the camera's x looks out of the lens, the
    tag's x out of its printed face (a tag on the back has yaw 180 degrees). ``tracking_camera`` is
    the T265's pose frame (x out of its lens side, REP 103), pitched 90 degrees when it looks down.
    """

    name: str  # as the file's: its namespace, its topics, its bag
    system_id: int  # of MAVLink (SYSID_THISMAV); each vehicle has its own
    tag_id: int  # of the tag36h11 on its back; each vehicle has its own
    tag_size_m: float  # edge of the black square
    camera: Mount  # x out of the lens
    tracking_camera: Mount  # pose frame of the T265: x out of its lens side
    tag: Mount  # x out of its printed face
    radius_m: float = 0.25  # rotors included

    def __post_init__(self):
        if not self.name.isidentifier():
            raise ValueError(f"name: '{self.name}' is not a ROS name; use letters, digits and _")
        if not 1 <= self.system_id <= 255:
            raise ValueError(f"system_id: {self.system_id} is not in 1..255")
        if not 0 <= self.tag_id <= MOST_TAG_ID:
            raise ValueError(f"tag_id: {self.tag_id} is not in family tag36h11 (0..{MOST_TAG_ID})")
        if self.tag_size_m <= 0:
            raise ValueError(f"tag_size_m: {self.tag_size_m} must be positive")
        if self.radius_m <= 0:
            raise ValueError(f"radius_m: {self.radius_m} must be positive")

    @property
    def T_body_cam(self) -> np.ndarray:
        """Camera's optical frame in the body frame."""
        return self.camera.T_body_part @ transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))

    @property
    def T_body_t265(self) -> np.ndarray:
        return self.tracking_camera.T_body_part

    @property
    def T_body_tag(self) -> np.ndarray:
        """Its tag's frame."""
        return self.tag.T_body_tag


def load_vehicles(folder, names: Iterable[str]) -> Dict[str, VehicleGeometry]:
    """Named vehicles from ``folder``/NAME.yaml, in order. Raises ConfigError on a clash of ids or
    names."""
    vehicles: Dict[str, VehicleGeometry] = {}
    for name in names:
        path = Path(folder) / f"{name}.yaml"
        vehicle = config.load(path, VehicleGeometry)
        if vehicle.name != name:
            raise config.ConfigError(f"{path}: name is '{vehicle.name}', the file says '{name}'")
        for other in vehicles.values():
            if other.tag_id == vehicle.tag_id:
                raise config.ConfigError(
                    f"{path}: tag_id {vehicle.tag_id} is also {other.name}'s; tags must differ"
                )
            if other.system_id == vehicle.system_id:
                raise config.ConfigError(
                    f"{path}: system_id {vehicle.system_id} is also {other.name}'s"
                )
        vehicles[name] = vehicle
    return vehicles
