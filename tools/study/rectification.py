# SPDX-License-Identifier: Apache-2.0
"""Why the thesis went from Bouguet's rectification to the decoupled one, and from that to home."""

import methods
import numpy as np
from page import Page, panels, percent
from scenes import CAMERA, Scatter, Shot, city

from fcsv_geometry import transforms
from fcsv_stereo.evaluating.evaluation import band
from fcsv_stereo.rectify import RECTIFIERS
from fcsv_stereo.thesis import ThesisOptions, map_thesis
from fcsv_stereo.thesis.matchers import DisparityWindow, match, match_rate

_WAYS = ("bouguet", "decoupled", "home")
#: What the vehicles do: how they stand off their place and vibrate, and how well that is known.
_SITUATIONS = (
    ("level, on its place", Scatter(), 8.0),
    ("0.2 m off its place", Scatter(place_m=0.2), 1.0),
    ("0.2 m off, tracked to 5 cm", Scatter(place_m=0.2, pose_share=0.05 * 3**0.5), 1.0),
    ("vibrating by 2°", Scatter(attitude_rad=np.radians(2.0)), 8.0),
    (
        "vibrating by 2°, 3 cm off, tracked to 0.15° and 1 %",
        Scatter(0.03, np.radians(2.0), 0.01, np.radians(0.15)),
        8.0,
    ),
)
_SEEDS = (1, 2, 3)


def rectification(page: Page) -> None:
    """Each way in each situation, horizontal and vertical; medians over seeds."""
    scene, rows, shown, titles = city(), [], [], []
    for words, scatter, baseline_m in _SITUATIONS:
        for axis in ("horizontal", "vertical"):
            for way in _WAYS:
                seeds = _SEEDS if scatter != Scatter() else _SEEDS[:1]
                found = [_one(scene, Shot(axis, baseline_m), scatter, seed, way) for seed in seeds]
                turned, misfit, kept, rate, within = np.median([f[:5] for f in found], axis=0)
                rows.append(
                    (
                        words,
                        f"{axis[0].upper()} {baseline_m:g} m",
                        way,
                        f"{turned:.1f}°",
                        f"{misfit:.2f} px",
                        percent(kept),
                        percent(rate),
                        percent(within),
                    )
                )
                if axis == "horizontal" and words in (_SITUATIONS[1][0], _SITUATIONS[3][0]):
                    shown.append(found[0][5])
                    titles.append(f"{way}, {words}")
    page.text(
        "## Rectification: why the thesis gave up the first two ways (4.5, 5.5, 6.5)",
        "*Turned*: angle between the rectified reference and the level one. *Rows off*: median distance of a true "
        "correspondence from its row (vertical: column). *Kept*: share of the reference picture that is left. The "
        "matcher is SGBM, which searches rows. *Within 10 %*: of the pixels up to 60 m per metre of baseline. All are "
        "medians of three seeds.",
        "Bouguet's way has exact rows with exact poses and turns the pair: by more than ten degrees for 0.2 m off a "
        "baseline of 1 m. The decoupled way and home ignore the displacement across the baseline; home does not follow "
        "a vibrating reference.",
    )
    page.table(
        ("vehicles", "pair", "way", "turned", "rows off", "kept", "matched", "within 10 %"), rows
    )
    page.figure(panels(shown, titles, 3), "rectification", "The rectified reference in each way")


def _one(scene, shot: Shot, scatter: Scatter, seed: int, way: str):
    given, truth = scene.given([shot], scatter, seed)
    reference, other = given.configurations[0].references[0], given.configurations[0].others[0]
    pair = RECTIFIERS[way](reference, other, shot.axis)
    turned = np.degrees(
        transforms.rotation_angle(
            transforms.transform(pair.R_home_rect, np.zeros(3)),
            transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3)),
        )
    )
    T_true, _ = scene.poses([shot], scatter, seed)[1][0]
    misfit = _misfit(pair, reference, other, T_true, truth)
    disparity = match(pair, "sgbm", DisparityWindow(8, 256))
    depth = map_thesis(
        given, ThesisOptions(matcher="sgbm", rectifier=way, threshold=methods.UNTRIMMED), _quiet
    ).depth
    within = band(depth, truth, (0.0, min(400.0, 60.0 * shot.baseline_m))).within_10_percent
    return (
        turned,
        misfit,
        float(pair.mask_reference.mean()),
        match_rate(disparity),
        within,
        pair.reference,
    )


def _misfit(pair, reference, other, T_home_true, truth) -> float:
    """Median distance (px) across the axis between a point's places in both rectified pictures; the
    true point is seen through the true pose and rectified by what is believed."""
    keep = truth <= 400.0
    rays = CAMERA.rays()[keep]
    p_home = (rays * truth[keep][:, None]) @ reference.T_home_cam[:3, :3].T + reference.T_home_cam[
        :3, 3
    ]
    T = transforms.invert(T_home_true)
    seen = p_home @ T[:3, :3].T + T[:3, 3]
    inside = seen[:, 2] > 1.0
    uv = seen[inside, :2] / seen[inside, 2:]
    half = np.array([CAMERA.width / 2 / CAMERA.fx, CAMERA.height / 2 / CAMERA.fy])
    shared = (np.abs(uv) <= half).all(axis=1)
    a = (
        rays[inside][shared]
        @ (pair.K_reference @ pair.R_home_rect.T @ reference.T_home_cam[:3, :3]).T
    )
    b = (
        np.column_stack([uv, np.ones(len(uv))])[shared]
        @ (pair.K_other @ pair.R_home_rect.T @ other.T_home_cam[:3, :3]).T
    )
    across = 1 - pair.axis_index
    return float(np.median(np.abs(a[:, across] / a[:, 2] - b[:, across] / b[:, 2])))


def _quiet(*_):
    pass
