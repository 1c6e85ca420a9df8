# SPDX-License-Identifier: Apache-2.0
"""Several configurations: trimming (figure 3.11), H against V (3.12) and both (3.13), two at once
(3.15)."""

import cv2
import methods
import numpy as np
from page import Page, metres, panels, percent
from scenes import CAMERA, FLIGHT, Shot, city

from fcsv_geometry import transforms
from fcsv_stereo.evaluating.evaluation import band
from fcsv_stereo.thesis import ThesisOptions
from fcsv_stereo.thesis.matchers import DisparityWindow

_WINDOW = DisparityWindow(11, 256)
_MOST_M = 400.0


def trimming(page: Page) -> None:
    """2, 4, 6, 8 m; 10 %; trimmed, and simply put together."""
    shots = [Shot("horizontal", b) for b in (2.0, 4.0, 6.0, 8.0)]
    rows, shown = [], []
    for words, scatter in (("exact", None), ("as flown", FLIGHT)):
        given, truth = city().given(shots, scatter)
        results = methods.run_all(given, ThesisOptions(window=_WINDOW))
        untrimmed = [p.depth for p in results["thesis"].pairs]
        rows.append((words, "all points, not trimmed", *_union(untrimmed, truth)))
        for name, result in results.items():
            label = "trimmed (3.2)" if name == "thesis" else name
            rows.append((words, label, *_union([result.depth], truth)))
        if scatter is None:
            shown = [given.configurations[0].references[0].image, truth, np.fmin.reduce(untrimmed)]
            shown += [r.depth for r in results.values()]
    page.text(
        "## Trimming against none (figure 3.11)",
        "2, 4, 6, 8 m with 10 %: trim points 120, 240, 361, 481 m. Without trimming every pixel has up to four "
        "points, with the wrong ones of all baselines. *As flown*: places scattered by 3 cm and 1°, priors wrong "
        "by 0.15° per axis and 1 % of the baseline.",
    )
    head = (
        "poses",
        "points",
        "points per pixel",
        "wrong by more than 10 %",
        "median error",
        "pixels within 10 %",
    )
    page.table(head, rows)
    titles = ["reference", "truth", "not trimmed (nearest point)"] + [
        "trimmed (3.2)" if n == "thesis" else n for n in methods.names()
    ]
    page.figure(panels(shown, titles, 2), "3_11_trimming", "Depth trimmed and not")


def axes(page: Page) -> None:
    """H and V of 4 m apart and together."""
    scene = city()
    h, v = Shot("horizontal", 4.0), Shot("vertical", 4.0)
    options = ThesisOptions(window=_WINDOW, threshold=methods.UNTRIMMED)
    truth, image = None, None
    found, hidden = {}, {}
    for label, shots in (("H", [h]), ("V", [v]), ("H and V", [h, v])):
        given, truth = scene.given(shots)
        image = given.configurations[0].references[0].image
        for name in methods.names():
            found[name, label] = methods.run(name, given, options).depth
        if len(shots) == 1:
            hidden[label] = _hidden(truth, shots[0].T_home_cam, given)
    upright, lying = _edges(image)
    page.text(
        "## Horizontal against vertical (figure 3.12), and fused (3.13)",
        "4 m each, exact poses, nothing trimmed. Shares are of the reference's pixels up to 400 m. *Outside*: "
        "not in the other camera's picture. *Hidden*: behind something nearer there. *Upright*: pixels on "
        "vertical edges (posts, corners). *Lying*: pixels on horizontal edges (eaves, kerbs).",
    )
    page.table(("axis", "outside", "hidden"), [(k, *map(percent, hidden[k])) for k in ("H", "V")])
    rows = []
    for name in methods.names():
        for label in ("H", "V", "H and V"):
            depth = found[name, label]
            b = band(depth, truth, (0.0, _MOST_M))
            rows.append(
                (
                    name,
                    label,
                    percent(b.coverage),
                    percent(b.within_10_percent),
                    percent(b.wrong_of_answered),
                    percent(b.median_relative_error),
                    percent(_good(depth, truth, upright)),
                    percent(_good(depth, truth, lying)),
                )
            )
    page.table(
        (
            "method",
            "axis",
            "covered",
            "within 10 %",
            "wrong of answered",
            "median error",
            "upright within 10 %",
            "lying within 10 %",
        ),
        rows,
    )
    for name in methods.names():
        shown = [found[name, k] for k in ("H", "V", "H and V")]
        page.figure(
            panels(shown, [f"{name}: {k}" for k in ("H", "V", "H and V")], 3),
            f"3_13_axes_{name}",
            f"H, V and both, {name}",
        )


def at_once(page: Page) -> None:
    """Two drones besides the reference: H 2 m, V 4 m, one depth image."""
    shots = [Shot("horizontal", 2.0), Shot("vertical", 4.0)]
    given, truth = city().given(shots)
    rows, shown, titles = [], [], []
    apart = methods.run("thesis", given, ThesisOptions(window=_WINDOW))
    for pair, label in zip(apart.pairs, ("H 2 m", "V 4 m")):
        shown.append(pair.depth)
        titles.append(f"thesis: {label}")
    results = {
        "thesis, one range for both (3.2, 3.6)": methods.run(
            "thesis", given, ThesisOptions(window=_WINDOW, across_axes=True)
        ),
        "thesis, each axis its own (3.4)": apart,
    }
    results.update(
        {n: methods.run(n, given, ThesisOptions()) for n in methods.names() if n != "thesis"}
    )
    for label, result in results.items():
        b = band(result.depth, truth, (0.0, 240.0))
        rows.append(
            (
                label,
                percent(b.coverage),
                percent(b.within_10_percent),
                percent(b.wrong_of_answered),
                percent(b.median_relative_error),
                f"{result.timing_s['cpu']:.1f} s",
            )
        )
        shown.append(result.depth)
        titles.append(label)
    page.text(
        "## Two configurations at once (figure 3.15)",
        "Two vehicles besides the reference, H 2 m and V 4 m at the same time, exact poses; pixels up to 240 m, "
        "where 4 m hold 10 %.",
    )
    page.table(
        (
            "fused by",
            "covered",
            "within 10 %",
            "wrong of answered",
            "median error",
            "processor time",
        ),
        rows,
    )
    page.figure(panels(shown, titles, 2), "3_15_at_once", "Two configurations, one depth image")


def _union(depths, truth):
    """Points per pixel, share of wrong points, median error of points, share of pixels right with
    most of them."""
    inside = truth <= _MOST_M
    stack = np.stack(depths)[:, inside]
    with np.errstate(invalid="ignore"):
        relative = np.abs(stack / truth[inside] - 1.0)
    known = np.isfinite(relative)
    good = np.nansum(relative <= 0.1, axis=0)
    right = (good > 0) & (2 * good > known.sum(axis=0))
    errors = relative[known]
    metre = np.abs(stack - truth[inside])[known]
    return (
        f"{known.sum() / inside.sum():.2f}",
        percent(float((errors > 0.1).mean())),
        f"{np.median(errors):.2%} ({metres(float(np.median(metre)))})",
        percent(float(right.mean())),
    )


def _hidden(truth, T_home_cam, given):
    """Shares of the reference's pixels up to 400 m that lie outside the other picture, and behind
    something there."""
    reference = given.configurations[0].references[0]
    _, other_depth = city().photograph(T_home_cam)
    rays = CAMERA.rays()
    p = transforms.invert(T_home_cam) @ reference.T_home_cam
    q = (rays * truth[..., None]) @ p[:3, :3].T + p[:3, 3]
    u = q[..., 0] / q[..., 2] * CAMERA.fx + CAMERA.cx
    v = q[..., 1] / q[..., 2] * CAMERA.fy + CAMERA.cy
    judged = truth <= _MOST_M
    inside = (
        judged
        & (q[..., 2] > 0)
        & (u >= 0)
        & (u <= CAMERA.width - 1)
        & (v >= 0)
        & (v <= CAMERA.height - 1)
    )
    there = other_depth[np.rint(v[inside]).astype(int), np.rint(u[inside]).astype(int)]
    hidden = there < q[..., 2][inside] * 0.97  # steep ground differs by a little within a pixel
    return 1.0 - inside.sum() / judged.sum(), hidden.sum() / judged.sum()


def _edges(image):
    """Pixels on edges that stand upright, and on those that lie, as masks."""
    gray = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.0)
    gx, gy = np.abs(cv2.Sobel(gray, -1, 1, 0)), np.abs(cv2.Sobel(gray, -1, 0, 1))
    return (gx > 40) & (gx > 4 * gy), (gy > 40) & (gy > 4 * gx)


def _good(depth, truth, mask) -> float:
    mask = mask & (truth <= _MOST_M)
    with np.errstate(invalid="ignore"):
        return float((np.abs(depth[mask] / truth[mask] - 1.0) <= 0.1).mean())
