# SPDX-License-Identifier: Apache-2.0
"""The ground robot: its gimbals, the vehicle that each follows, and the tags on those
(config/gimbal/*.yaml)."""

from dataclasses import dataclass, field
from typing import Dict, List, Sequence, Tuple

import numpy as np

from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.vehicles.vehicle import MOST_TAG_ID, Mount
from fcsv_tracking.gimbal.geometry import Angles, GimbalGeometry


@dataclass(frozen=True)
class BodyTag:
    """A tag on a vehicle; its mount's x looks out of the printed face."""

    id: int  # of family tag36h11
    size_m: float  # edge of the black square
    mount: Mount  # on the vehicle; x out of the printed face

    def __post_init__(self):
        if not 0 <= self.id <= MOST_TAG_ID:
            raise ValueError(f"id: {self.id} is not in family tag36h11 (0..{MOST_TAG_ID})")
        if not 0.01 <= self.size_m <= 1.0:
            raise ValueError(
                f"size_m: {self.size_m} is not in 0.01..1: the black square's edge in metres"
            )

    @property
    def T_body_tag(self) -> np.ndarray:
        return self.mount.T_body_tag


@dataclass(frozen=True)
class GimbalServo:
    """Ids on the bus, the readings at pan and tilt zero (ticks of 360/4096 degrees), and which way
    they count."""

    pan_id: int = 1  # on the bus
    tilt_id: int = 2  # on the bus
    pan_zero: int = 2048  # reading (ticks of 360/4096 degrees) at pan 0
    tilt_zero: int = 2048  # reading at tilt 0
    pan_sign: int = 1  # 1: counts up to the left
    tilt_sign: int = 1  # 1: counts up upwards

    def __post_init__(self):
        for name in ("pan", "tilt"):
            if not 0 <= getattr(self, f"{name}_id") <= 252:
                raise ValueError(f"{name}_id: {getattr(self, f'{name}_id')} is not in 0..252")
            if not 0 <= getattr(self, f"{name}_zero") <= 4095:
                raise ValueError(f"{name}_zero: {getattr(self, f'{name}_zero')} is not in 0..4095")
            if getattr(self, f"{name}_sign") not in (-1, 1):
                raise ValueError(f"{name}_sign: {getattr(self, f'{name}_sign')} must be 1 or -1")
        if self.pan_id == self.tilt_id:
            raise ValueError(f"tilt_id: {self.tilt_id} is also pan's; every servo needs its own")


@dataclass(frozen=True)
class Gimbal:
    """One gimbal and the vehicle it follows; at ``start_deg`` (pan, tilt) it begins to search."""

    vehicle: str  # that it follows
    geometry: GimbalGeometry  # where it sits on the robot
    tags: List[BodyTag]  # that the vehicle wears
    servo: GimbalServo = field(default_factory=GimbalServo)
    start_deg: Tuple[float, float] = (0.0, 20.0)  # pan, tilt at which it begins to search

    def __post_init__(self):
        if not self.tags:
            raise ValueError(f"tags: {self.vehicle} wears none; name at least one")

    @property
    def start(self) -> Angles:
        return self.geometry.clipped(Angles(*map(float, np.radians(self.start_deg))))


@dataclass(frozen=True)
class GroundRobot:
    """All gimbals of one ground robot."""

    gimbals: List[Gimbal]  # one for each vehicle

    def __post_init__(self):
        if not self.gimbals:
            raise ValueError("gimbals: is empty; name at least one")
        require_different("gimbals", "vehicle", [g.vehicle for g in self.gimbals])
        require_different("gimbals", "tag id", [t.id for g in self.gimbals for t in g.tags])
        require_different(
            "gimbals",
            "servo id",
            [i for g in self.gimbals for i in (g.servo.pan_id, g.servo.tilt_id)],
        )

    @property
    def by_vehicle(self) -> Dict[str, Gimbal]:
        return {g.vehicle: g for g in self.gimbals}


def load_ground_robot(path) -> GroundRobot:
    """Raises ConfigError naming file and field."""
    return config.load(path, GroundRobot)


def load_gimbals(path, vehicles: Sequence[str]) -> Dict[str, Gimbal]:
    """Gives those of a file that follow ``vehicles``. Raises ConfigError as load_ground_robot, and
    where one has none."""
    found = load_ground_robot(path).by_vehicle
    missing = [name for name in vehicles if name not in found]
    if missing:
        raise ConfigError(f"{path}: no gimbal follows {missing[0]}; it has {', '.join(found)}")
    return {name: found[name] for name in vehicles}


def require_different(where: str, what: str, values: List) -> None:
    """Checks, for a dataclass's ``__post_init__``: ValueError where a value of ``where`` is there
    twice."""
    twice = [v for v in values if values.count(v) > 1]
    if twice:
        raise ValueError(f"{where}: {what} {twice[0]} is there twice; each must be different")
