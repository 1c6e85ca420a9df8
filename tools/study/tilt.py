# SPDX-License-Identifier: Apache-2.0
"""Inward tilt of 1 degree per metre against none (figure 3.14): near objects, and the sky."""

import dataclasses

import methods
import numpy as np
from page import Page, metres, panels, percent
from scenes import CAMERA, Shot, city

from fcsv_stereo.evaluating.evaluation import band
from fcsv_stereo.planning.overlap import overlap_starts_m
from fcsv_stereo.rectify import home
from fcsv_stereo.thesis import ThesisOptions
from fcsv_stereo.thesis.matchers import DisparityWindow, match

_WINDOW = DisparityWindow(32, 256)  # 3.5
_NEAR_M = 40.0


def tilt(page: Page) -> None:
    """2, 4, 6, 8 m, parallel and tilted, exact poses, 32 px at least."""
    scene = city()
    rows, shown, titles = [], [], []
    for per_m_deg in (0.0, 1.0):
        for b in (2.0, 4.0, 6.0, 8.0):
            shot = Shot("horizontal", b, np.radians(per_m_deg * b))
            given, truth = scene.given([shot])
            sky = ~np.isfinite(truth)
            meet_m = overlap_starts_m(b, np.radians(56.0), shot.tilt_rad)
            pair = home(
                given.configurations[0].references[0],
                given.configurations[0].others[0],
                shot.axis,
                shot.tilt_rad,
            )
            for name in methods.names():
                depth = methods.run(
                    name, given, ThesisOptions(window=_WINDOW, threshold=methods.UNTRIMMED)
                ).depth
                near = band(depth, truth, (0.0, _NEAR_M))
                naive = percent(_sky_without_offset(pair, sky)) if name == "thesis" else "–"
                nearest = np.nanpercentile(depth, 0.5)
                rows.append(
                    (
                        f"{b:g} m",
                        f"{per_m_deg * b:g}°",
                        name,
                        metres(meet_m),
                        f"{nearest:.1f} m",
                        percent(near.coverage),
                        percent(near.within_10_percent),
                        percent(float(np.isfinite(depth[sky]).mean())),
                        naive,
                    )
                )
                if name == "thesis":
                    shown.append(depth)
                    titles.append(shot.name)
    page.text(
        "## Inward tilt (figure 3.14)",
        f"The other camera is turned inward by 1° per metre of baseline; at least 32 px, as in 3.5; pixels up to "
        f"{_NEAR_M:g} m. A tilted pair has the sky at f tan(tilt) px (84 px at 8°). Last column: a "
        "matcher that ignores that offset takes the sky for near.",
    )
    page.table(
        (
            "baseline",
            "tilt",
            "method",
            "views meet at",
            "nearest (0.5 %)",
            "near: covered",
            "near: within 10 %",
            "sky answered",
            "sky without the offset",
        ),
        rows,
    )
    page.figure(
        panels(shown, titles, 4, (6.0, 150.0)),
        "3_14_tilt",
        "Depth without tilt (above) and with (below)",
    )


def _sky_without_offset(pair, sky) -> float:
    """Share of the sky that passes the window where disparities are taken as they are matched (the
    thesis)."""
    same = dataclasses.replace(pair, K_other=pair.K_reference)
    assert sky.shape == (CAMERA.height, CAMERA.width)
    return float(np.isfinite(match(same, "quasi-dense", _WINDOW))[sky].mean())
