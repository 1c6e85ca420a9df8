# SPDX-License-Identifier: Apache-2.0
"""The measured mount in config/vehicles/NAME.yaml, everything else in the file left as it is."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from fcsv_geometry import config, transforms
from fcsv_geometry.vehicles.vehicle import Mount, VehicleGeometry
from fcsv_tracking.errors import ExtrinsicsRefused
from fcsv_tracking.mounts.refine import MountSolution


def mount_of(vehicle: VehicleGeometry, solution: MountSolution) -> Mount:
    """Describes the mount as a person would type it: forward-left-up, metres and degrees."""
    plain = replace(vehicle, **{solution.part: Mount((0.0, 0.0, 0.0))})
    T_flu_part = plain.T_body_cam if solution.part == "camera" else plain.T_body_tag
    T_body_flu = solution.T_body_part @ transforms.invert(T_flu_part)
    xyz_m = tuple(round(float(v), 5) for v in T_body_flu[:3, 3])
    rpy_deg = tuple(round(float(v), 4) for v in np.degrees(transforms.rpy(T_body_flu)))
    return Mount(xyz_m, rpy_deg)


def write_mount(source: Path, target: Path, solution: MountSolution) -> VehicleGeometry:
    """``source`` with the part's mount replaced, to ``target`` (may be the same); the vehicle as it
    reads back.

    Raises ConfigError on a source that is no vehicle, ExtrinsicsRefused where the text cannot be
    edited safely.
    """
    vehicle = config.load(source, VehicleGeometry)
    mount = mount_of(vehicle, solution)
    line = (
        f"{solution.part}: {{xyz_m: {list(mount.xyz_m)}, rpy_deg: {list(mount.rpy_deg)}}}"
        f"  # calibrate_mounts: 1 sigma {solution.position_std_m * 1e3:.1f} mm, {solution.rotation_std_deg:.2f} deg, "
        f"{solution.used} views, rms {solution.reprojection_rms_px:.2f} px"
    )
    block = re.compile(rf"^{solution.part}:[^\n]*(\n[ \t]+[^\n]*)*", re.MULTILINE)
    text, count = block.subn(lambda _: line, Path(source).read_text())
    expected = replace(vehicle, **{solution.part: mount})
    if count != 1:
        raise ExtrinsicsRefused(
            f"{source}: '{solution.part}' does not stand at the start of one line; write it by hand"
        )
    temporary = Path(target).with_suffix(".yaml.new")
    temporary.write_text(text)
    try:
        if config.load(temporary, VehicleGeometry) != expected:
            raise ExtrinsicsRefused(
                f"{source}: editing would change more than '{solution.part}'; write it by hand: {line}"
            )
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)
    return expected
