# SPDX-License-Identifier: Apache-2.0
"""The cloud to be turned by hand: thinned, drawn by plotly, whose script is in the page; no network
is needed.

The script and the points are gzip in base64, which browsers unpack themselves (DecompressionStream,
since 2023).
"""

from functools import lru_cache

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.model import Cloud, MapResult
from fcsv_stereo.near import NEAR_BASELINE
from fcsv_stereo.report.figures import T_view_home
from fcsv_stereo.report.parts import CloudView, packed

MOST_POINTS = 40000  # about 0.6 MB of the page; ordinary graphics turn so many smoothly
_STEP_M = 0.01  # points are rounded to it: they compress better
_BEHIND, _ABOVE = 1.3, 0.45  # where the eye stands at first, in units of the drawn box


def cloud_view(result: MapResult) -> CloudView:
    """What the page needs to draw the cloud and the cameras, x forward where home is level (else as
    ``from_above``)."""
    import plotly.graph_objects as go
    from plotly.io.json import to_json_plotly

    cloud, T_view_cam = result.cloud, T_view_home(result)
    keep = np.sort(
        np.random.default_rng(0).choice(len(cloud), min(MOST_POINTS, len(cloud)), replace=False)
    )
    points = transforms.apply(T_view_cam, cloud.points_home_m[keep].astype(float))
    points = (np.round(points / _STEP_M) * _STEP_M).astype(np.float32)
    colours = [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in cloud.colors[keep]]
    cameras = transforms.apply(
        T_view_cam, np.array([i.T_home_cam[:3, 3] for i in result.images]).reshape(-1, 3)
    )
    marks = ["#d62728" if i.name == result.reference.name else "#1f77b4" for i in result.images]
    figure = go.Figure(
        [
            go.Scatter3d(
                x=points[:, 0],
                y=points[:, 1],
                z=points[:, 2],
                mode="markers",
                name="points",
                marker={"size": 1.6},
                hovertemplate=_HOVER,
                customdata=_sigma_m(cloud[keep]),
            ),
            go.Scatter3d(
                x=cameras[:, 0],
                y=cameras[:, 1],
                z=cameras[:, 2],
                mode="markers",
                name="cameras",
                marker={"size": 4, "color": marks, "symbol": "diamond"},
                text=[i.name for i in result.images],
                hovertemplate="%{text}<extra></extra>",
            ),
            go.Scatter3d(
                x=[],
                y=[],
                z=[],
                mode="lines+markers+text",
                name="measured",
                hoverinfo="skip",
                marker={"size": 5, "color": "#000000"},
                line={"width": 4, "color": "#000000"},
                text=["A", "B"],
            ),
        ]
    )
    figure.update_layout(
        template="none",
        showlegend=False,
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        height=640,
        scene=_scene(),
    )
    drawn = figure.to_plotly_json()
    drawn["data"][0]["marker"]["color"] = colours  # plotly would look at each of them for seconds
    T_view_reference = T_view_cam @ result.reference.T_home_cam
    drawn["view"] = {
        "camera_m": T_view_reference[:3, 3].tolist(),
        "axis": T_view_reference[:3, 2].tolist(),
        "is_level": result.reference.is_level,
    }
    return CloudView(_script(), packed(to_json_plotly(drawn).encode()), len(keep), len(cloud))


def _sigma_m(cloud: Cloud) -> np.ndarray:
    """(N,) standard deviation of depth; NaN for points of a depth camera, which are seen from
    elsewhere."""
    return np.where(
        cloud.baseline_index == NEAR_BASELINE, np.nan, np.round(cloud.sigma_m, 3)
    ).astype(np.float32)


_HOVER = "x %{x:.1f} m, y %{y:.1f} m, z %{z:.1f} m<extra></extra>"


def _scene() -> dict:
    axes = {f"{a}axis": {"title": {"text": f"{a} (m)"}} for a in "xyz"}
    eye = {
        "eye": {"x": -_BEHIND, "y": 0.0, "z": _ABOVE},
        "center": {"x": -0.1, "y": 0.0, "z": -0.1},
    }
    return {**axes, "aspectmode": "data", "camera": eye, "dragmode": "orbit"}


@lru_cache(maxsize=1)
def _script() -> str:
    from plotly.offline import get_plotlyjs

    return packed(get_plotlyjs().encode())
