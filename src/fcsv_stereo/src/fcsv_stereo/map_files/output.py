# SPDX-License-Identifier: Apache-2.0
"""OUT/: map.ply, depth.npy, sigma.npy, kind.npy, reference.png, report.json, report.html; all of
it, or none."""

import json
import re
from pathlib import Path
from typing import Iterable, Optional

import cv2
import numpy as np

from fcsv_geometry.programs.writing import in_words
from fcsv_geometry.version import VERSION
from fcsv_stereo.errors import OutputError
from fcsv_stereo.evaluating.evaluation import Evaluation
from fcsv_stereo.evaluating.ground_sample import GroundSample
from fcsv_stereo.map_files.picture_list import picture_list
from fcsv_stereo.model import Cloud, MapResult
from fcsv_stereo.model.inputs import NO_SHIFT
from fcsv_stereo.model.kinds import masks
from fcsv_stereo.posed.local_origin import moved
from fcsv_stereo.products import names
from fcsv_stereo.products.clouds import origin_line

FILES = (
    "map.ply",
    "depth.npy",
    "sigma.npy",
    "kind.npy",
    "reference.png",
    "report.json",
    "report.html",
)
#: map.ply's vertices: the names and types that readers know
_VERTEX = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("red", "u1"),
        ("green", "u1"),
        ("blue", "u1"),
        ("sigma", "<f4"),
        ("baseline", "u1"),
    ]
)
_COLUMNS = (("x", "y", "z"), ("red", "green", "blue"))
_PLY_NAMES = {"<f4": "float", "|u1": "uchar"}
_MOST_HEADER_BYTES = 4096
_ORIGIN = re.compile(rb"\ncomment origin_m (\S+) (\S+) (\S+)")
_AT_A_TIME = 1 << 18  # points: clouds of large pictures
_HEADER = re.compile(
    rb"ply\r?\nformat binary_little_endian 1\.0\r?\n((?:comment[^\n]*\n)*)element vertex (\d+)\r?\n"
    rb"((?:property [^\n]*\n)*)end_header\r?\n"
)


def check_out(out: Path) -> None:
    """An earlier map may be replaced, anything else is left alone. Raises OutputError."""
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out}: is a file; give a folder with -o")
    foreign = (
        [p.name for p in out.iterdir() if p.name not in (*FILES, *names.FILES)]
        if out.exists()
        else []
    )
    if foreign:
        raise OutputError(
            f"{out}: holds '{foreign[0]}', which is not of a map; give another folder with -o"
        )


def write_arrays(result: MapResult, folder: Path) -> None:
    """map.ply, depth.npy, sigma.npy, kind.npy, and the undistorted picture that they belong to."""
    write_ply(result.cloud, folder / "map.ply", result.origin_m)
    np.save(folder / "depth.npy", result.depth.astype(np.float32))
    np.save(folder / "sigma.npy", result.sigma.astype(np.float32))
    np.save(folder / "kind.npy", result.kind.astype(np.uint8))
    if not cv2.imwrite(
        str(folder / "reference.png"), cv2.cvtColor(result.reference.image, cv2.COLOR_RGB2BGR)
    ):
        raise OutputError(f"{folder / 'reference.png'}: cannot be written; is the disk full?")


def write_ply(cloud: Cloud, path: Path, origin_m: np.ndarray = NO_SHIFT) -> None:
    """A map's cloud as ``write_clouds``."""
    write_clouds([cloud], len(cloud), path, origin_m)


def write_clouds(
    clouds: Iterable[Cloud],
    count: int,
    path: Path,
    origin_m: np.ndarray = NO_SHIFT,
    last: str = "baseline",
) -> None:
    """``count`` points of one cloud after the other: binary little-endian PLY: x y z (home, m), red
    green blue, sigma (m), baseline (index of the configuration, 255: of a depth camera). A comment
    says ``origin_m`` where x y z plus this are in home. ``last``: the name of the last property,
    where it is another.

    Raises OutputError where the disk does not take it.
    """
    comment = f"comment {origin_line(origin_m)}\n" if np.any(origin_m) else ""
    properties = _properties().replace(" baseline\n", f" {last}\n")
    head = f"ply\nformat binary_little_endian 1.0\n{comment}element vertex {count}\n{properties}end_header\n"
    try:
        with path.open("wb") as file:
            file.write(head.encode())
            for cloud in clouds:
                for i in range(0, len(cloud), _AT_A_TIME):
                    file.write(_vertices(cloud[i : i + _AT_A_TIME]).tobytes())
    except OSError as error:
        raise OutputError(in_words(error, path)) from error


def _vertices(cloud: Cloud) -> np.ndarray:
    vertices = np.empty(len(cloud), _VERTEX)
    for columns, values in zip(_COLUMNS, (cloud.points_home_m, cloud.colors)):
        for name, column in zip(columns, values.T):
            vertices[name] = column
    vertices["sigma"], vertices["baseline"] = cloud.sigma_m, cloud.baseline_index
    return vertices


def _properties() -> str:
    return "".join(f"property {_PLY_NAMES[_VERTEX[name].str]} {name}\n" for name in _VERTEX.names)


def read_ply(path: Path) -> Cloud:
    """What write_ply wrote. Raises OutputError where there is none, and on another layout."""
    if not Path(path).is_file():
        raise OutputError(f"{path}: does not exist")
    content = Path(path).read_bytes()
    head = _HEADER.match(content[:_MOST_HEADER_BYTES])
    if head is None or head.group(3).replace(b"\r", b"") != _properties().encode():
        raise OutputError(f"{path}: is not a map.ply of this program")
    count = int(head.group(2))
    if len(content) - head.end() != count * _VERTEX.itemsize:
        raise OutputError(f"{path}: is cut: {count} points do not fit into its size")
    v = np.frombuffer(content, _VERTEX, count, head.end())
    points, colors = (np.stack([v[n] for n in columns], axis=-1) for columns in _COLUMNS)
    return Cloud(points, colors, v["sigma"].copy(), v["baseline"].copy())


def read_ply_origin(path: Path) -> np.ndarray:
    """(3,): x y z of a map.ply plus this are in home."""
    with Path(path).open("rb") as file:
        found = _ORIGIN.search(file.read(_MOST_HEADER_BYTES).split(b"end_header")[0])
    return np.array([float(v) for v in found.groups()]) if found else NO_SHIFT.copy()


def report_document(result: MapResult, evaluation: Optional[Evaluation] = None) -> dict:
    """report.json (design, "Commands that stay")."""
    camera, origin_m = result.reference.camera, result.origin_m
    document = {
        "fcsv_version": VERSION,
        "method": result.method,
        "reference": {
            "image": result.reference.name,
            "width": camera.width,
            "height": camera.height,
            "fx": camera.fx,
            "fy": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "stamp_s": result.reference.stamp_s,
            "T_home_cam": moved(result.reference.T_home_cam, origin_m).tolist(),
        },
        "images": [
            {
                "name": e.name,
                "T_home_cam": moved(e.T_home_cam, origin_m).tolist(),
                "prior_T_home_cam": moved(e.prior_T_home_cam, origin_m).tolist(),
                "refined": e.refined,
                "inliers": e.inliers,
                "epipolar_rms_px": e.epipolar_rms_px,
            }
            for e in result.images
        ],
        "configurations": [
            {
                "name": p.configuration.name,
                "axis": p.configuration.axis.value,
                "baseline_m": p.configuration.baseline_m,
                "tilt_deg": float(np.degrees(p.configuration.tilt_rad)),
                "effective_range_m": [round(float(x), 3) for x in p.effective_range_m],
                "match_rate": p.match_rate,
                "pair": [p.reference_name, p.other_name],
                "skew_ms": round(1e3 * result.skews_s[p.other_name], 1)
                if p.other_name in result.skews_s
                else None,
            }
            for p in result.pairs
        ],
        "coverage": result.coverage,
        "kinds": {name: float(mask.mean()) for name, mask in masks(result.kind).items()},
        "points": result.points,
        "timing_s": {k: round(v, 4) for k, v in result.timing_s.items()},
        "ground_sample": GroundSample.of(result).to_dict(),
        "pictures": [p.to_dict() for p in picture_list(result)],
        "spare_pictures": dict(result.spare),
        "warnings": result.warnings,
        "unseen": result.unseen,
    }
    if result.is_shifted:
        document["origin_m"] = result.origin_m.tolist()
    if result.gps is not None:
        document["gps"] = result.gps.to_dict()
    if result.clocks:
        document["time_offsets"] = {
            vehicle: clock.to_dict() for vehicle, clock in result.clocks.items()
        }
    if result.cut is not None:
        document["cloud"] = result.cut.to_dict()
    if result.holes is not None:
        document["orthophoto"] = result.holes.to_dict()
    if result.ground is not None:
        document["ground"] = result.ground.to_dict()
    if result.near is not None:
        document["near"] = result.near.to_dict()
    if evaluation is not None:
        document["truth"] = evaluation.to_dict()
    return document


def write_report_json(document: dict, folder: Path) -> None:
    (folder / "report.json").write_text(json.dumps(document, indent=1, allow_nan=False))
