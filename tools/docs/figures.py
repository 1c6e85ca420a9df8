# SPDX-License-Identifier: Apache-2.0
"""Draws docs/figures/*.svg, the drawings of docs/user/concepts.md; --check only tells which are not
as drawn here."""

import argparse
import sys
from pathlib import Path

import numpy as np
from drawing import BLUE, GREEN, GREY, ORANGE, RED, Drawing, turned

from fcsv_stereo.equations import ErrorThreshold, depth_error, farthest

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "figures"
FOCAL_PX, SIZE_PX = 602.0, (640, 480)  # the camera of thesis table 6.2
HALF_DEG = [float(np.degrees(np.arctan(s / 2 / FOCAL_PX))) for s in SIZE_PX]
BASELINES_M, COLORS = (2, 4, 6, 8), (BLUE, GREEN, ORANGE, RED)


def rig() -> Drawing:
    """Baseline, axis, tilt."""
    d = Drawing(800, 330, "A horizontal pair, a vertical pair, and a pair that is tilted inwards")
    half, tall = np.tan(np.radians(HALF_DEG))
    for x, title, view in (
        (10, "horizontal axis", "from above"),
        (285, "vertical axis", "from the side"),
        (540, "horizontal, tilted inwards", "from above"),
    ):
        d.text((x, 24), title, bold=True, size=15)
        d.text((x, 44), view, GREY)
    _seen_from_above(d, (95, 260), 80, half, tilt_deg=0)
    _seen_from_above(d, (600, 260), 100, half, tilt_deg=10)
    low, high, reach = (320, 230), (320, 150), 190
    for at, color in ((low, BLUE), (high, GREEN)):
        d.area(
            [at, (at[0] + reach, at[1] - tall * reach), (at[0] + reach, at[1] + tall * reach)],
            color,
        )
        d.camera(at, color, 90)
    meet = 80 / (2 * tall)
    d.area([(320 + meet, 190), (510, 230 - tall * reach), (510, 150 + tall * reach)], GREY, 0.45)
    d.arrow((297, 150), (297, 230), both=True)
    d.text((291, 195), "b", anchor="end", bold=True)
    d.text((306, 258), "uav1, reference", BLUE)
    d.text((306, 132), "uav3", GREEN)
    d.text((400, 318), "grey: what both cameras see", GREY, anchor="middle")
    return d


def _seen_from_above(d: Drawing, at, baseline, half, tilt_deg):
    reach, other = 150, (at[0] + baseline, at[1])
    left, right = (float(np.tan(np.radians(s * HALF_DEG[0] - tilt_deg))) for s in (-1, 1))
    d.area([at, (at[0] - half * reach, at[1] - reach), (at[0] + half * reach, at[1] - reach)], BLUE)
    d.area(
        [
            other,
            (other[0] + left * reach, at[1] - reach),
            (other[0] + right * reach, at[1] - reach),
        ],
        ORANGE,
    )
    meet = baseline / (half - left)
    d.area(
        [
            (at[0] + half * meet, at[1] - meet),
            (other[0] + left * reach, at[1] - reach),
            (at[0] + half * reach, at[1] - reach),
        ],
        GREY,
        0.45,
    )
    d.camera(at, BLUE)
    d.camera(other, ORANGE, -tilt_deg)
    if tilt_deg:
        d.line(other, turned(other, 120, 0), GREY, 1, "4 3")
        d.line(other, turned(other, 120, -tilt_deg), ORANGE, 1)
        d.text((other[0] + 5, at[1] - 100), "tilt")
    d.arrow((at[0], at[1] + 18), (other[0], at[1] + 18), both=True)
    d.text((at[0] + baseline / 2, at[1] + 34), "b", anchor="middle", bold=True)
    d.text((at[0] - 12, at[1] + 22), "uav1", BLUE, anchor="end")
    d.text((other[0] + 12, at[1] + 22), "uav2", ORANGE)


def error() -> Drawing:
    """Equation 2.12 of four baselines, and how far each holds 10 % (3.1)."""
    d = Drawing(760, 400, "Error of depth against distance, for baselines of 2, 4, 6 and 8 m")
    ten = ErrorThreshold(0.10, True)

    def at(z_m, error_m):
        return 70 + z_m * 1.28, 340 - error_m * 4.6

    for z_m in range(0, 501, 50):
        d.line(at(z_m, 0), at(z_m, 66), "#e5e5e5", 1)
        d.text((at(z_m, 0)[0], 358), str(z_m), anchor="middle", size=12)
    for error_m in range(0, 61, 10):
        d.line(at(0, error_m), at(500, error_m), "#e5e5e5", 1)
        d.text((62, at(0, error_m)[1] + 4), str(error_m), anchor="end", size=12)
    d.line(at(0, 0), at(500, 50), GREY, 1.5, "6 4")
    d.text(at(505, 48.5), "10 %", GREY)
    for baseline_m, color in zip(BASELINES_M, COLORS):
        z_m = np.linspace(0, 500, 101)
        error_m = depth_error(z_m, baseline_m, FOCAL_PX)
        shown = error_m <= 62
        d.path([at(*p) for p in zip(z_m[shown], error_m[shown])], color, 2.5)
        end = float(z_m[shown][-1])
        d.text(
            at(end + 4, 62.5 if end < 495 else float(error_m[-1]) + 1.5),
            f"{baseline_m} m",
            color,
            bold=True,
        )
        far = farthest(baseline_m, FOCAL_PX, ten)
        d.line(at(far, 0), at(far, far * 0.1), color, 1.2, "3 3")
        d.dot(at(far, far * 0.1), color, 5)
        d.text(at(far + 4, 3), f"{far:.0f} m", color, size=12)
    d.text((375, 384), "distance z in m", anchor="middle")
    d.text((70, 22), "error of depth in m, for 1 px of disparity at f = 602 px (2.12)")
    return d


def frames() -> Drawing:
    """The tree of frames, and the two kinds of axes."""
    d = Drawing(800, 330, "The frames: home, odometry, body, camera, tag")
    d.box(20, 130, 100, 50, ["home", "z up"], GREY)
    for i, (name, color) in enumerate((("uav1", BLUE), ("uav2", ORANGE))):
        y = 60 + 150 * i
        d.box(205, y + 5, 120, 40, [f"{name}/odom"], color)
        d.box(400, y + 5, 135, 40, [f"{name}/base_link"], color)
        d.arrow((120, 145 + 20 * i), (205, y + 25))
        d.arrow((325, y + 25), (400, y + 25))
        d.text((362, y + 17), "odometry", size=11, anchor="middle")
        for j, end in enumerate(("camera_optical", "tag")):
            d.box(605, y - 18 + 48 * j, 165, 36, [f"{name}/{end}"], color)
            d.arrow((535, y + 25), (605, y + 48 * j))
        d.text((570, y + 70), "mounts", size=11, anchor="middle")
    d.text((160, 72), "set_home,", size=11, anchor="middle")
    d.text((160, 86), "calibration", size=11, anchor="middle")
    body, eye = (95, 290), (330, 270)
    of_body = (("x forward", 60, 0, BLUE), ("z up", 0, -50, RED), ("y left", -32, -28, GREEN))
    of_eye = (("z forward", 60, 0, BLUE), ("y down", 0, 45, RED), ("x right", 32, 26, GREEN))
    for start, names in ((body, of_body), (eye, of_eye)):
        for words, x, y, color in names:
            tip = (start[0] + x, start[1] + y)
            d.arrow(start, tip, color, 2)
            d.text(
                (tip[0] + (-6 if x < 0 else 6), tip[1] + 5),
                words,
                color,
                12,
                "end" if x < 0 else "start",
            )
    d.text((95, 320), "bodies, home, maps", anchor="middle")
    d.text((415, 320), "optical frames, tag")
    return d


def chain() -> Drawing:
    """Pose chain of the calibration, thesis 6.1."""
    d = Drawing(800, 250, "The chain of poses from the odometry of uav2 to that of uav1")
    names = (
        ("uav2", ORANGE, ("odom", "base_link", "camera")),
        ("uav1", BLUE, ("tag", "base_link", "odom")),
    )
    d.text((20, 26), "uav2, behind", ORANGE, bold=True, size=15)
    d.text((780, 26), "uav1, in front", BLUE, anchor="end", bold=True, size=15)
    for i, (_, color, boxes) in enumerate(names):
        for j, name in enumerate(boxes):
            d.box(20 + 400 * i + 133 * j, 60, 94, 44, [name], color)
    for i, words in enumerate(("odometry", "mount", "tag seen", "mount", "odometry")):
        x = 114 + 133 * i + (1 if i > 2 else 0)
        d.arrow((x, 82), (x + 39, 82), RED if i == 2 else GREY, 3 if i == 2 else 1.5)
        d.text((x + 19, 124), words, RED if i == 2 else GREY, 12, "middle")
    for i, words in enumerate(("T_O2_D2", "T_D2_C2", "T_C2_A1", "inv(T_D1_A1)", "inv(T_O1_D1)")):
        d.text((133 + 133 * i, 144), words, size=12, anchor="middle")
    d.line((67, 160), (67, 190))
    d.line((733, 160), (733, 190))
    d.arrow((67, 190), (733, 190))
    d.text(
        (400, 182),
        "T_O2_O1: the calibration (x, y, z, yaw; both odometries are level)",
        anchor="middle",
        bold=True,
    )
    d.text(
        (400, 224),
        "many detections, while the vehicle in front sways; outliers are rejected, the spread is told",
        GREY,
        anchor="middle",
    )
    return d


def refinement() -> Drawing:
    """Rays of one point miss each other with the poses as tracked, and meet after the
    adjustment."""
    d = Drawing(800, 320, "Refinement: rays of the same points miss before and meet after")
    points = ((110, 80), (200, 60), (280, 95))
    for x, title, words, off in (
        (0, "as tracked", "rays of one point miss: an error in px in every picture", 1.0),
        (400, "refined", "poses moved until the rays of all points meet", 0.0),
    ):
        d.text((x + 20, 26), title, bold=True, size=15)
        cameras = (
            (x + 140, 270, BLUE, 0.0),
            (x + 205, 270, ORANGE, 3.2 * off),
            (x + 270, 270, GREEN, -3.6 * off),
        )
        for cx, cy, color, wrong in cameras:
            for px, py in points:
                to = float(np.degrees(np.arctan2(x + px - cx, cy - py)))
                length = float(np.hypot(x + px - cx, cy - py)) + 12
                d.line((cx, cy), turned((cx, cy), length, to + wrong), color, 1.2)
            d.camera((cx, cy), color, wrong)
        for px, py in points:
            d.dot((x + px, py), "black", 4.5)
        d.text((x + 20, 308), words, GREY)
    d.line((400, 20), (400, 290), "#cccccc", 1)
    return d


def kinds() -> Drawing:
    """Why a pixel of the reference has its depth, or none; from above, the field of view drawn
    wide."""
    d = Drawing(800, 400, "Kinds of pixels: agreed, hidden, outside, blank, sky, moved")
    eye, other, wall, reach = (330.0, 340.0), (440.0, 340.0), 100.0, 240.0
    box, car = (370.0, 408.0, 205.0), (256.0, 290.0, 180.0)  # left, right, and how far down

    def on_wall(start, x, y):
        """Where the ray from ``start`` through (x, y) meets the wall."""
        return start[0] + (x - start[0]) * reach / (start[1] - y)

    for at, color in ((eye, BLUE), (other, ORANGE)):
        d.area([at, (at[0] - reach, wall), (at[0] + reach, wall)], color, 0.12)
        d.camera(at, color)
    far_left, far_right, shared = eye[0] - reach, eye[0] + reach, other[0] - reach
    hidden = [on_wall(other, x, box[2]) for x in box[:2]]
    behind = [on_wall(eye, x, box[2]) for x in box[:2]]
    gone = [on_wall(eye, x, car[2]) for x in car[:2]]
    blank_to = behind[1] + 55
    for start, end, color in (
        (far_left, shared, GREY),
        (shared, gone[0], GREEN),
        (gone[1], hidden[0], GREEN),
        (hidden[0], hidden[1], RED),
        (hidden[1], behind[0], GREEN),
        (behind[1], blank_to, "#d0d0d0"),
    ):
        d.line((start, wall), (end, wall), color, 10)
    d.line((box[0], box[2]), (box[1], box[2]), GREEN, 14)
    d.line((car[0], car[2]), (car[1], car[2]), "#CC79A7", 14)
    for x in box[:2]:
        d.line(other, (on_wall(other, x, box[2]), wall), ORANGE, 0.8, "3 3")
        d.line(eye, (on_wall(eye, x, box[2]), wall), BLUE, 0.8, "3 3")
    for words, x, color in (
        ("outside", (far_left + shared) / 2 - 8, GREY),
        ("agreed", (shared + gone[0]) / 2 + 8, GREEN),
        ("hidden", sum(hidden) / 2, RED),
        ("blank", (behind[1] + blank_to) / 2, GREY),
        ("sky", (blank_to + far_right) / 2 + 10, BLUE),
    ):
        d.text((x, wall - 14), words, color, anchor="middle", bold=True)
    d.text((box[1] + 8, box[2] + 5), "agreed", GREEN, bold=True)
    d.text((car[0] - 8, car[2] + 5), "moved", "#CC79A7", anchor="end", bold=True)
    d.text((eye[0], eye[1] + 28), "reference", BLUE, anchor="middle")
    d.text((other[0] + 6, other[1] + 28), "another vehicle", ORANGE, anchor="start")
    d.text((20, 30), "from above; the kinds are those of the reference's pixels", GREY)
    return d


DRAWINGS = {f.__name__: f for f in (rig, error, frames, chain, refinement, kinds)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--check", action="store_true", help="write nothing; exit status 1 where a file differs"
    )
    args = parser.parse_args()
    drawn = {FOLDER / f"{name}.svg": str(draw()) for name, draw in DRAWINGS.items()}
    other = [p for p, text in drawn.items() if not p.is_file() or p.read_text() != text]
    other += [p for p in FOLDER.glob("*.svg") if p not in drawn]
    for path in other:
        print(
            f"{path.name}: not as tools/docs/figures.py draws it" if args.check else f"wrote {path}"
        )
        if not args.check:
            path.write_text(drawn[path]) if path in drawn else path.unlink()
    return 1 if args.check and other else 0


if __name__ == "__main__":
    sys.exit(main())
