# SPDX-License-Identifier: Apache-2.0
"""Real photographs that lie beside the checkout: a pair with true depth, and one with surveyed
poses alone."""

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from bench.hard_cases import Case
from fcsv_geometry import transforms
from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.model import MapInput, MapResult
from fcsv_stereo.model.kinds import masks, supported
from fcsv_stereo.posed import colmap
from fcsv_stereo.thesis import Thesis, ThesisOptions
from fcsv_stereo.thesis.matchers import DisparityWindow

SHARED = Path(__file__).resolve().parents[2].parent / "shared" / "data"
_MOTORCYCLE = {"f": 994.978, "baseline_m": 0.193001, "doffs": 31.086}
_REFERENCE = "0005.jpg"
# by whom the two maps are
_APART = (("0003.jpg", "0006.jpg", "0008.jpg"), ("0002.jpg", "0004.jpg", "0007.jpg"))
_NEXT = (("0004.jpg",), ("0006.jpg",))  # SGBM, one pair each
_WRONG = 0.1


def motorcycle() -> Optional[Case]:
    """The pair with its truth, which is unknown (infinite) where its disparity is; None where it is
    not there."""
    source, m = SHARED / "motorcycle", _MOTORCYCLE
    if not source.is_dir():
        return None
    disparity = np.load(source / "motorcycle_disp.npz")
    disparity = disparity[disparity.files[0]]
    height, width = disparity.shape
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "images").mkdir()
        for side in ("left", "right"):
            shutil.copy(source / f"motorcycle_{side}.png", Path(folder) / "images")
        cx = (width / 2, width / 2 + m["doffs"])
        lines = [
            f"{i + 1} PINHOLE {width} {height} {m['f']} {m['f']} {c} {height / 2}\n"
            for i, c in enumerate(cx)
        ]
        (Path(folder) / "cameras.txt").write_text("".join(lines))
        (Path(folder) / "images.txt").write_text(
            f"1 1 0 0 0 0 0 0 1 motorcycle_left.png\n\n2 1 0 0 0 {-m['baseline_m']} 0 0 2 motorcycle_right.png\n\n"
        )
        given = colmap.read_photographs(Path(folder), None)
    known = np.isfinite(disparity) & (disparity > 0)
    depth = m["f"] * m["baseline_m"] / (np.where(known, disparity, 1.0) + m["doffs"])
    return Case("Motorcycle", given, np.where(known, depth, np.inf).astype(np.float32), given)


def measure_fountain() -> List[str]:
    """A table's lines; none where it is not there. Nobody knows the true depth: two maps of one
    reference, by other pictures each, whose errors are of their own but for the camera's, are
    compared with each other."""
    source = SHARED / "fountain"
    if not source.is_dir():
        return []
    given = colmap.read_photographs(source, _REFERENCE)
    surveyed = {
        i.name: i.T_home_cam
        for i in colmap.read_images(
            source / "truth_images.txt", colmap.read_cameras(source / "cameras.txt")
        )
    }
    maps = [Joint().map(_by(given, names), JointOptions()) for names in _APART]
    told = [supported(m.kind) & np.isfinite(m.depth) for m in maps]
    agreed = [masks(m.kind)["agreed"] & t for m, t in zip(maps, told)]
    before, after = rotation_errors_deg(given, maps, surveyed)
    sgbm = [
        Thesis().map(
            _exact(_by(given, n), surveyed), ThesisOptions(matcher="sgbm", window=DisparityWindow())
        )
        for n in _NEXT
    ]
    lines = [
        "Fountain: two maps of one picture, by three others each, compared with each other; SGBM by one other each, "
        f"surveyed poses. Rotation errors of the priors: median {np.median(before):.3f}°, worst {max(before):.3f}°; "
        f"after refinement {np.median(after):.3f}° and {max(after):.3f}°.",
        "",
        "| pixels | both answer | differ by more than 10 % | by more than 2 % | median | within 1σ of both | 2σ |",
        "|---|---|---|---|---|---|---|",
    ]
    parts = (
        ("answered", maps, told),
        ("agreed", maps, agreed),
        ("SGBM", sgbm, [np.isfinite(m.depth) for m in sgbm]),
    )
    for name, (a, b), (of_a, of_b) in parts:
        both = of_a & of_b
        off, sigma = np.abs(a.depth - b.depth)[both], np.hypot(a.sigma, b.sigma)[both]
        relative = off / a.depth[both]
        shares = [both.mean(), (relative > _WRONG).mean(), (relative > 0.02).mean()]
        within = (
            ["–", "–"] if name == "SGBM" else [f"{(off <= k * sigma).mean():.1%}" for k in (1, 2)]
        )
        told_of = [*(f"{s:.1%}" for s in shares), f"{np.median(relative):.2%}", *within]
        lines.append(f"| {name} | {' | '.join(told_of)} |")
    return lines


def rotation_errors_deg(
    given: MapInput, maps: Sequence[MapResult], surveyed: Dict[str, np.ndarray]
) -> Tuple[List[float], List[float]]:
    """Of the pictures that the maps are by, relative to the reference: as given, and in the
    maps."""
    others = {p.name: p.T_home_cam for c in given.configurations for p in c.others}
    T_home_reference = given.configurations[0].references[0].T_home_cam
    before, after = [], []
    for m in maps:
        for i in m.images:
            if i.name in others and i.name != m.reference.name:
                R = _relative(surveyed[m.reference.name], surveyed[i.name])
                for found, T in (
                    (before, _relative(T_home_reference, others[i.name])),
                    (after, _relative(m.reference.T_home_cam, i.T_home_cam)),
                ):
                    found.append(float(np.degrees(transforms.rotation_angle(R, T))))
    return before, after


def _relative(T_home_a: np.ndarray, T_home_b: np.ndarray) -> np.ndarray:
    return T_home_a[:3, :3].T @ T_home_b[:3, :3]


def _by(given: MapInput, names: Sequence[str]) -> MapInput:
    return replace(
        given, configurations=[c for c in given.configurations if c.others[0].name in names]
    )


def _exact(given: MapInput, surveyed: Dict[str, np.ndarray]) -> MapInput:
    """With surveyed poses; the reference's is home's, as ``colmap`` has it."""
    configurations = []
    for c in given.configurations:
        T_home_world = c.references[0].T_home_cam @ transforms.invert(
            surveyed[c.references[0].name]
        )
        others = [replace(p, T_home_cam=T_home_world @ surveyed[p.name]) for p in c.others]
        configurations.append(replace(c, others=others))
    return replace(given, configurations=configurations)
