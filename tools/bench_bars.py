# SPDX-License-Identifier: Apache-2.0
"""Whether map --bars holds on what it was not tuned on; the table is in docs/lab/tilting.md#bars.

.venv/bin/python tools/bench_bars.py [--scenes 12] [--out FOLDER]

Drawn scenes: a rig of 0.2 m before a far background of soft or hard texture, with 1 to 5 straight
bars, 10 to 60 mm wide, 1.5 to 8 m away, dark or bright, up to 60 degrees from the upright, each its
own. Photographs, where shared/data lies beside the checkout: Motorcycle with its truth. Pixels of
bars (of the photographs: all) within 10 % of the depth, without and with bars; filled: pixels to
which bars gave a depth; how many of these are right, or would be one pixel aside.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import List, Tuple

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from bench.photographs import motorcycle
from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.joint.bars import with_bars
from fcsv_stereo.model import Axis, Configuration, ConfigurationInput, MapInput, Picture, PosePrior

# of a rig that was calibrated: 0.01 degrees, 0.2 mm
_RECTIFIED = PosePrior(np.radians(0.01), 0.0002, 0.0)
_CAMERA = PinholeCamera(640, 480, 600.0, 600.0, 319.5, 239.5)
_BASELINE_M, _NOISE, _LARGER, _RIGHT = 0.2, 2.0, 4, 0.1


@dataclass(frozen=True)
class Bar:
    """``x_m`` at the middle row; ``lean`` columns to the row; ``grey`` 0..255."""

    x_m: float
    z_m: float
    width_m: float
    lean: float
    grey: float

    def corners(self, eye_m: float) -> np.ndarray:
        """(4, 2) px in the picture of a camera ``eye_m`` to the right."""
        rows = np.array([-5.0, _CAMERA.height + 5.0])
        middle = (
            _CAMERA.fx * (self.x_m - eye_m) / self.z_m
            + _CAMERA.cx
            + self.lean * (rows - _CAMERA.cy)
        )
        half = 0.5 * _CAMERA.fx * self.width_m / self.z_m * np.hypot(1.0, self.lean)
        sides = [middle - half, middle + half]
        return np.array([[sides[i][j], rows[j]] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))])


@dataclass(frozen=True)
class Scene:
    """Bars before a plane ``behind_m`` away, whose texture is ``soft_px`` and ``contrast`` grey
    levels."""

    seed: int
    bars: List[Bar]
    behind_m: float
    soft_px: float
    contrast: float

    @staticmethod
    def drawn(seed: int) -> "Scene":
        """The same for the same seed."""
        r = np.random.default_rng([seed, 77])
        bars = []
        for _ in range(r.integers(1, 6)):
            z, dark = r.uniform(1.5, 8.0), r.random() < 0.5
            grey = r.uniform(10, 60) if dark else r.uniform(170, 240)
            bars.append(
                Bar(
                    r.uniform(-0.4, 0.4) * z,
                    z,
                    r.uniform(0.01, 0.06),
                    np.tan(r.uniform(-1.05, 1.05)),
                    grey,
                )
            )
        return Scene(
            seed,
            sorted(bars, key=lambda b: -b.z_m),
            r.uniform(12.0, 80.0),
            r.uniform(1.0, 6.0),
            r.uniform(3.0, 25.0),
        )

    def picture(self, eye_m: float) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """rgb (H,W,3 uint8), depth (H,W), which bar (H,W; -1: none)."""
        height, width, k = _CAMERA.height, _CAMERA.width, _LARGER
        random = np.random.default_rng([self.seed, 5])
        specks = random.normal(0.0, 1.0, (height, width + 80)).astype(np.float32)
        texture = cv2.GaussianBlur(specks, (0, 0), self.soft_px)
        texture = 115.0 + self.contrast * (texture - texture.mean()) / texture.std()
        move = np.float32([[1, 0, -40.0 - _CAMERA.fx * eye_m / self.behind_m], [0, 1, 0]])
        grey = cv2.warpAffine(
            texture, move, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
        )
        large = cv2.resize(grey, None, fx=k, fy=k, interpolation=cv2.INTER_LINEAR)
        on = np.full((height, width), -1, np.int32)
        for n, bar in enumerate(self.bars):
            corners = np.round((bar.corners(eye_m) + 0.5) * k * 16 - 8).astype(np.int32)
            cv2.fillConvexPoly(large, corners, float(bar.grey), shift=4)
            mask = np.zeros((height * k, width * k), np.uint8)
            cv2.fillConvexPoly(mask, corners, 255, shift=4)
            on[cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA) > 127] = n
        noise = np.random.default_rng([self.seed, int(1e3 * eye_m)]).normal(
            0.0, _NOISE, (height, width)
        )
        grey = cv2.resize(large, (width, height), interpolation=cv2.INTER_AREA) + noise
        depth = np.array([*(b.z_m for b in self.bars), self.behind_m])[on]
        return np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2), depth, on

    def given(self) -> Tuple[MapInput, np.ndarray, np.ndarray]:
        """What is mapped, true depth and bars of the left picture."""
        (left, depth, on), (right, _, _) = self.picture(0.0), self.picture(_BASELINE_M)
        a = Picture("left", "rig", 0.0, left, _CAMERA, transforms.transform(np.eye(3), np.zeros(3)))
        b = Picture(
            "right",
            "rig",
            0.0,
            right,
            _CAMERA,
            transforms.transform(np.eye(3), [_BASELINE_M, 0.0, 0.0]),
        )
        c = ConfigurationInput(Configuration(Axis.HORIZONTAL, _BASELINE_M, 0.0, "rig"), [a], [b])
        return MapInput("photographs", [c], prior=PosePrior(1e-4, 1e-4, 1e-4)), depth, on


def row(
    name: str, given: MapInput, truth: np.ndarray, on: np.ndarray, options: JointOptions
) -> str:
    """A row of the table; ``on`` (H,W bool) where bars are."""
    plain = Joint().map(given, options)
    barred = with_bars(plain, [p.pictures for p in plain.pairs])
    known = np.isfinite(truth)
    right = [known & (np.abs(m.depth - truth) <= _RIGHT * truth) for m in (plain, barred)]
    cells = [f"{m[on].mean():.1%}" if on.any() else f"{m[known].mean():.1%} of all" for m in right]
    filled = np.isfinite(barred.depth) & (barred.depth != plain.depth) & known
    if not filled.any():
        return f"| {name} | {' | '.join(cells)} | nothing | – | – |"
    shares = (f"{r[filled].mean():.0%}" for r in (right[1], beside(barred.depth, truth)))
    return f"| {name} | {' | '.join(cells)} | {filled.sum():,} | {' | '.join(shares)} |"


def beside(depth: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Where (H,W bool) a depth is that of its pixel, or of one beside it: an edge is nobody's whole
    pixel."""
    around = [np.roll(truth, (r, c), (0, 1)) for r in (-1, 0, 1) for c in (-1, 0, 1)]
    return np.any([np.abs(depth - t) <= _RIGHT * t for t in around], axis=0)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--out", type=Path, help="folder for the drawn pictures")
    args = parser.parse_args()
    head = ("scene", "bars' pixels within 10 %", "with bars", "filled (px)", "right", "or beside")
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    case = motorcycle()
    if case is not None:
        truth, nowhere = case.true_depth, np.zeros(case.true_depth.shape, bool)
        known = JointOptions(prior=_RECTIFIED)
        print(row("Motorcycle (photographs)", case.given, truth, nowhere, known), flush=True)
    options = Joint().trusting_poses(JointOptions())  # as of a rig
    for seed in range(1, args.scenes + 1):
        scene = Scene.drawn(seed)
        given, depth, on = scene.given()
        if args.out:
            args.out.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(args.out / f"{seed}.png"), scene.picture(0.0)[0])
        words = ", ".join(f"{1e3 * b.width_m:.0f} mm at {b.z_m:.1f} m" for b in scene.bars)
        print(row(f"{seed}: {words}", given, depth, on >= 0, options), flush=True)


if __name__ == "__main__":
    main()
