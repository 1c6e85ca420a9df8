# SPDX-License-Identifier: Apache-2.0
"""The tags on the sides of a robot on the ground, by which vehicles see where it is: ``tags`` of
config/robots/NAME.yaml."""

from dataclasses import dataclass
from typing import Dict, Mapping, Sequence, Tuple

from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_tracking.gimbal.config import BodyTag, require_different

#: The edge of a tag that is read in most pictures (docs/lab/guidance.md#by-its-tags).
READ_PX = 18.0


@dataclass(frozen=True)
class _Tagged:
    tags: Tuple[BodyTag, ...] = ()

    def __post_init__(self):
        require_ids_once(self.tags)


def require_ids_once(tags: Sequence[BodyTag]) -> None:
    """Checks, for a dataclass's ``__post_init__``: ValueError where two tags have one id."""
    require_different("tags", "id", [t.id for t in tags])


def load_robot_tags(path, vehicles: Mapping[str, VehicleGeometry]) -> Dict[int, BodyTag]:
    """The tags of a robot's file by id, empty where it has none; z counts from the ground.

    Raises ConfigError naming file and field; also where a vehicle carries one of them.
    """
    document = config.read_yaml(path)
    named = document.get("tags", []) if isinstance(document, Mapping) else []
    tags = config.from_mapping({"tags": named}, _Tagged, str(path)).tags
    for name, vehicle in vehicles.items():
        if vehicle.tag_id in [t.id for t in tags]:
            raise ConfigError(
                f"{path}: tags: id {vehicle.tag_id} is also {name}'s; tags must differ"
            )
    return {t.id: t for t in tags}


def readable_m(tags: Sequence[BodyTag], focal_px: float) -> float:
    """How far away (m) a camera reads the largest of the tags, face on."""
    return max(t.size_m for t in tags) * focal_px / READ_PX
