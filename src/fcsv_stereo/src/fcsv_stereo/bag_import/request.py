# SPDX-License-Identifier: Apache-2.0
"""What a user asks of an import: cameras, where their poses are, and how many pictures of which
baselines.
"""

import math
from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.errors import InputError

#: What a mount may be apart from numbers and a frame of tf: T_pose_optical.
AXES = {"optical": np.eye(4), "camera": transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))}


@dataclass(frozen=True)
class CameraRequest:
    """One camera.

    ``topic`` has its pictures. ``pose`` is a topic of poses, a frame of tf or a file of TUM's
    format. ``mount`` says how the optical frame lies to what the pose is of (``numbers_of``, or a
    frame of tf); None: by tf. ``info``: the topic of its camera_info; None: beside its pictures.
    ``axes``: of the frame that its pictures name, "optical" or "camera"; None: by its name.
    ``offset_s`` is added to the stamps of its pictures.
    """

    topic: str
    pose: str
    mount: Optional[str] = None
    info: Optional[str] = None
    axes: Optional[str] = None
    offset_s: float = 0.0

    def __post_init__(self):
        if not math.isfinite(self.offset_s):
            raise InputError(f"--offset-s {self.offset_s}: is no time")


@dataclass(frozen=True)
class ImportRequest:
    """``range_m``: how far away the scene is. ``most``: pictures in all. ``reference_s``: stamp of
    the reference.

    ``world``: the frame in which poses of tf are given; None: the root of its tree. ``gap_s``: the
    longest silence of poses that is bridged; None: four of their usual periods, 0.1 to 0.4 s.
    ``by_receipt``: the time at which a message was recorded counts in place of its stamp.
    """

    cameras: Tuple[CameraRequest, ...]
    range_m: float
    most: int = 8
    reference_s: Optional[float] = None
    world: Optional[str] = None
    gap_s: Optional[float] = None
    by_receipt: bool = False

    def __post_init__(self):
        if not (math.isfinite(self.range_m) and self.range_m > 0.0):
            raise InputError(f"--range-m {self.range_m:g}: the distance of the scene is above 0 m")
        if self.most < 2:
            raise InputError(f"--most {self.most}: a pair needs two pictures")
        if self.gap_s is not None and not (math.isfinite(self.gap_s) and self.gap_s > 0.0):
            raise InputError(
                f"--gap-s {self.gap_s:g}: the longest silence that is bridged is above 0 s"
            )
        topics = [c.topic for c in self.cameras]
        if len(set(topics)) < len(topics):
            raise InputError("--camera names one topic twice")


def numbers_of(mount: str) -> Optional[np.ndarray]:
    """T_pose_optical (4, 4) of "optical", "camera" or "x,y,z,roll,pitch,yaw" (m, degrees); None
    where it is none.

    The six numbers place the camera as a body (x forward, y left, z up) in the frame that the pose
    is of. Raises InputError where six were meant.

    >>> np.allclose(numbers_of("0,0,0,0,0,0"), numbers_of("camera"))
    True
    """
    if mount in AXES:
        return AXES[mount]
    words = mount.split(",")
    if len(words) == 1:
        return None
    try:
        x, y, z, *rpy_deg = map(float, words)
        if len(rpy_deg) != 3 or not np.isfinite([x, y, z, *rpy_deg]).all():
            raise ValueError(mount)
    except ValueError as error:
        raise InputError(
            f"--mount {mount}: six numbers are meant, x,y,z,roll,pitch,yaw in m and degrees"
        ) from error
    return transforms.from_xyz_rpy([x, y, z], np.radians(rpy_deg)) @ AXES["camera"]


def each(option: str, values: Sequence, count: int, default=None) -> Tuple:
    """One for each camera: given once it serves all. Raises InputError.

    >>> each("--mount", ["optical"], 2)
    ('optical', 'optical')
    """
    if not values:
        return (default,) * count
    if len(values) not in (1, count):
        raise InputError(
            f"{option} is given {len(values)} times for {count} camera{'s' * (count > 1)}: once, or once for each"
        )
    return tuple(values) if len(values) == count else (values[0],) * count
