# SPDX-License-Identifier: Apache-2.0
"""The command ``rosrun fcsv_stereo import_photos PHOTOS -o OUT`` (without ROS: ``fcsv
import-photos``)."""

import argparse
import shlex
from pathlib import Path
from typing import List, Optional

import numpy as np

from fcsv_geometry.programs import commands
from fcsv_stereo.photos.importing import Imported, ImportOptions, import_photos

POOR_LEVEL_DEG, POOR_NORTH_DEG = 5.0, 10.0  # said with a warning

_EXAMPLES = """examples:
  import_photos DCIM/ -o photos           poses by COLMAP (pip install pycolmap), metres by the photographs' GPS
  import_photos DCIM/ -o photos --model sparse/0     posed by COLMAP already: cameras and images, .txt or .bin
  map photos -o out/photos --reference DJI_0031.JPG
"""


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0 with a folder that ``map`` reads; 2 with one line on stderr, 130 on Ctrl-C, and
    nothing is left."""
    return commands.run(_parser(), argv, _import, left="nothing was written")


def _import(args) -> None:
    options = ImportOptions(Path(args.model) if args.model else None, args.longest_px)
    done = import_photos(Path(args.photographs), Path(args.out), options)
    print(table(done))
    print(f"wrote {args.out}: images/ ({len(done.names)}), cameras.txt, images.txt, priors.csv")
    print(f"map it: map {args.out} -o OUT --reference {shlex.quote(done.names[0])}")


def table(done: Imported) -> str:
    """Text: how far each photograph's GPS lies from where the model has it, and what that says of
    the whole."""
    s = done.similarity
    wide = max(map(len, ["photograph", *done.names]))
    lines = [f"{'photograph':<{wide}}{'east':>9}{'north':>9}{'up':>9}   GPS less model (m)"]
    for name, away_m in zip(done.names, s.residuals_m):
        numbers = "".join(f"{a:>+9.2f}" if np.isfinite(a) else f"{'-':>9}" for a in away_m)
        said = f"   {done.remarks[name]}" if name in done.remarks else ""
        lines.append(f"{name:<{wide}}{numbers}{said}")
    lines += [f"{name}: left out: {why}" for name, why in done.left_out.items()]
    level_deg, north_deg = np.degrees([s.level_sigma_rad, s.north_sigma_rad])
    lines.append(
        f"scale {s.scale:.6g} m per unit of the model, known to {s.scale_sigma:.2%}; level to {level_deg:.1f} degrees, "
        f"north to {north_deg:.1f}; GPS scatters {s.gps_factor:.2f} times as much as it says, the model itself by "
        f"{s.model_sigma_m:.2g} m"
    )
    if level_deg > POOR_LEVEL_DEG or north_deg > POOR_NORTH_DEG:
        lines.append(
            "WARNING: level and north are known poorly; gimbal angles or places further apart would tell them"
        )
    o = done.origin
    lines.append(
        f"home: {o.latitude_deg:.7f}, {o.longitude_deg:.7f}, {o.height_m:.2f} m; x east, y north, z up"
    )
    return "\n".join(lines)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="import_photos",
        description="GPS-tagged photographs as a folder that map reads, in metres.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add(
        "photographs",
        help="a folder of photographs with GPS in their tags, or of such folders (DCIM)",
    )
    add(
        "-o",
        "--out",
        required=True,
        help="new folder for images/, cameras.txt, images.txt, priors.csv",
    )
    add(
        "--model",
        metavar="FOLDER",
        help="their poses by COLMAP, text or binary; by default pycolmap finds them",
    )
    add(
        "--longest-px",
        type=int,
        default=ImportOptions.longest_px,
        metavar="PX",
        help="longer side of the copies (default %(default)s; 0: as it is; with --model always as it is)",
    )
    return parser
