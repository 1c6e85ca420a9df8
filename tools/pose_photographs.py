#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes an input of `map` from photographs: COLMAP finds their poses, GPS or known places give metres and up.

    .venv/bin/python tools/pose_photographs.py PHOTOS --gps                 # PHOTOS/images/, with GPS in their EXIF
    .venv/bin/python tools/pose_photographs.py PHOTOS --places places.txt   # a line per picture: NAME X Y Z (m, z up)

Needs the program colmap (Debian 12: apt install colmap; tried with 3.8). Writes PHOTOS/cameras.txt and
PHOTOS/images.txt once all is done; until then those that are there stay.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import List, Optional

PICTURES = {".jpg", ".jpeg", ".png", ".tif", ".tiff"}
WRITTEN = ("cameras.txt", "images.txt")


class PosingError(Exception):
    """What is wrong, and what to do."""


def main(argv: Optional[List[str]] = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", type=Path, help="a folder with images/")
    known = parser.add_mutually_exclusive_group(required=True)
    known.add_argument("--gps", action="store_true", help="places from the GPS in the pictures' EXIF")
    known.add_argument("--places", type=Path, help="places from a file: NAME X Y Z, metres, z up")
    parser.add_argument("--error-m", type=float, default=3.0, help="how far GPS or a place may be off (default: 3 m)")
    parser.add_argument("--camera-model", default="OPENCV", choices=["SIMPLE_RADIAL", "RADIAL", "OPENCV", "PINHOLE"],
                        help="COLMAP's model of the one camera that took all (default: OPENCV)")  # fmt: skip
    args = parser.parse_args(argv)
    try:
        with tempfile.TemporaryDirectory() as work:
            placed, taken = pose(args, Path(work))
    except PosingError as error:
        print(f"pose_photographs: {error}", file=sys.stderr)
        return 2
    left = sorted(set(taken) - set(placed))
    print(f"{len(placed)} of {len(taken)} pictures have a pose")
    if left:
        print(f"take these out of {args.photos / 'images'}, map refuses what has no pose: {', '.join(left)}")
    print(f"wrote {args.photos / WRITTEN[0]} and {args.photos / WRITTEN[1]}")
    print(f"map them: rosrun fcsv_stereo map {args.photos} -o OUT --reference {placed[len(placed) // 2]}")
    return 0


def pose(args, work: Path):
    """(names with a pose, all names); the text model is then in the folder of photographs."""
    images = args.photos / "images"
    taken = pictures(images)
    if args.places and not args.places.is_file():
        raise PosingError(f"{args.places} is not there")
    if shutil.which("colmap") is None:
        raise PosingError("the program colmap is not installed: apt install colmap")
    database, sparse, text = work / "database.db", work / "sparse", work / "text"
    for folder in (sparse, text):
        folder.mkdir()
    common = ["--database_path", database]
    colmap("feature_extractor", *common, "--image_path", images, "--ImageReader.single_camera", 1,
           "--ImageReader.camera_model", args.camera_model, "--SiftExtraction.use_gpu", 0)  # fmt: skip
    colmap("exhaustive_matcher", *common, "--SiftMatching.use_gpu", 0)
    colmap("mapper", *common, "--image_path", images, "--output_path", sparse)
    models = sorted(p for p in sparse.iterdir() if p.is_dir())
    if not models:
        raise PosingError("COLMAP found no poses: the pictures share too little, or have too little texture")
    largest = max(models, key=lambda m: (m / "images.bin").stat().st_size)
    aligned = work / "aligned"
    aligned.mkdir()
    align(args, largest, aligned, database)
    colmap("model_converter", "--input_path", aligned, "--output_path", text, "--output_type", "TXT")
    placed = names(text / "images.txt")
    for name in WRITTEN:
        shutil.copy(text / name, args.photos / name)
    return placed, taken


def align(args, model: Path, aligned: Path, database: Path):
    """The model turned, moved and scaled to metres, z up."""
    where = ["--ref_images_path", args.places, "--ref_is_gps", 0, "--alignment_type", "custom"]
    if args.gps:
        where = ["--database_path", database, "--ref_is_gps", 1, "--alignment_type", "enu"]
    try:
        colmap("model_aligner", "--input_path", model, "--output_path", aligned, *where,
               "--robust_alignment", 1, "--robust_alignment_max_error", args.error_m)  # fmt: skip
    except PosingError as error:
        ask = "is there GPS in at least three pictures" if args.gps else f"do the names agree with {args.places}"
        raise PosingError(f"{error}; {ask}, and is it right to {args.error_m:g} m (--error-m)?") from error
    if not (aligned / "images.bin").is_file():
        raise PosingError("COLMAP wrote no aligned model: fewer than three pictures have a place that fits")


def pictures(images: Path) -> List[str]:
    """Names of the pictures of a folder."""
    if not images.is_dir():
        raise PosingError(f"{images} is not there: put the pictures into it")
    found = sorted(p.name for p in images.glob("*") if p.suffix.lower() in PICTURES)
    if len(found) < 3:
        raise PosingError(f"{images} holds {len(found)} pictures; three or more are needed")
    return found


def names(images_txt: Path) -> List[str]:
    """Pictures of a text model, sorted."""
    lines = [s for s in images_txt.read_text().splitlines() if not s.startswith("#")]
    return sorted(" ".join(s.split()[9:]) for s in lines[::2] if s.strip())


def colmap(step: str, *words):
    """One of COLMAP's programs. Raises PosingError with its last words."""
    print(f"colmap {step}", flush=True)
    done = subprocess.run(["colmap", step, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True, errors="replace")  # fmt: skip
    if done.returncode:
        last = [s.strip() for s in done.stdout.splitlines() if s.strip()] or ["it said nothing"]
        raise PosingError(f"colmap {step} ended with status {done.returncode}: {last[-1]}")


if __name__ == "__main__":
    sys.exit(main())
