# SPDX-License-Identifier: Apache-2.0
"""Folders of posed photographs: some of the real ones, and two black pictures."""

import shutil

import cv2
import numpy as np


def fountain(shared_data, folder, names):
    """A model of some of the fountain's photographs with their surveyed poses."""
    source = shared_data / "fountain"
    (folder / "images").mkdir(parents=True)
    lines = [
        s
        for s in (source / "truth_images.txt").read_text().splitlines()
        if s.split() and s.split()[-1] in names
    ]
    (folder / "images.txt").write_text("".join(f"{s}\n\n" for s in lines))
    shutil.copy(source / "cameras.txt", folder)
    for name in names:
        shutil.copy(source / "images" / name, folder / "images")
    return folder


def motorcycle(shared_data, folder):
    """A model of the pair; its disparity, where that is truth, f (px), baseline (m), difference of
    cx (px)."""
    source = shared_data / "motorcycle"
    (folder / "images").mkdir()
    for side in ("left", "right"):
        shutil.copy(source / f"motorcycle_{side}.png", folder / "images")
    height, width = cv2.imread(str(source / "motorcycle_left.png")).shape[:2]
    f, baseline_m, doffs = 994.978, 0.193001, 31.086
    (folder / "cameras.txt").write_text(
        f"1 PINHOLE {width} {height} {f} {f} {width / 2} {height / 2}\n"
        f"2 PINHOLE {width} {height} {f} {f} {width / 2 + doffs} {height / 2}\n"
    )
    (folder / "images.txt").write_text(
        f"1 1 0 0 0 0 0 0 1 motorcycle_left.png\n\n2 1 0 0 0 {-baseline_m} 0 0 2 motorcycle_right.png\n\n"
    )
    archive = np.load(source / "motorcycle_disp.npz")
    disparity = archive[archive.files[0]]
    truth = np.isfinite(disparity) & (disparity > 0)
    return disparity, truth, f, baseline_m, doffs


def model(folder, cameras="1 PINHOLE 64 48 60 60 32 24\n", images=None, sizes=((64, 48), (64, 48))):
    (folder / "images").mkdir(parents=True, exist_ok=True)
    for name, (w, h) in zip("ab", sizes):
        cv2.imwrite(str(folder / "images" / f"{name}.png"), np.zeros((h, w, 3), np.uint8))
    (folder / "cameras.txt").write_text(cameras)
    (folder / "images.txt").write_text(
        images or "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 -1 0 0 1 b.png\n\n"
    )
    return folder
