# SPDX-License-Identifier: Apache-2.0
"""Picture and depth in one place, with a slider between both; depth, sigma and kind of each pixel
for the page."""

import base64
import io
import json

import numpy as np
from matplotlib.colors import to_hex
from PIL import Image

from fcsv_stereo.model import MapResult
from fcsv_stereo.model.kinds import MOST_PAIRS, NAMES, WORDS
from fcsv_stereo.report.figures import depth_colours, drawn_picture, drawn_values
from fcsv_stereo.report.parts import PixelView, packed

DEPTH_STEP, SIGMA_STEP = 1e-3, 1e-2  # of the logarithm: depth to 0.05 %, sigma to 0.5 %
MOST_PIXELS = 700_000  # about 1 MB of the page; larger pictures are thinned
_STOPS = 9  # colours of the legend


def pixel_view(result: MapResult) -> PixelView:
    """What the page needs to show picture and depth, and to answer for each pixel
    (``templates/measure.js``).

    Every ``step``-th column and row is kept; ``width`` and ``height`` are those of the whole
    picture, px.
    """
    camera, reference = result.reference.camera, result.reference
    step = max(1, int(np.ceil(np.sqrt(result.depth.size / MOST_PIXELS))))
    kept = {n: getattr(result, n)[::step, ::step] for n in ("depth", "sigma", "kind")}
    depth_codes, depth_low = log_codes(kept["depth"], DEPTH_STEP)
    sigma_codes, sigma_low = log_codes(kept["sigma"], SIGMA_STEP)
    about = {
        "width": camera.width,
        "height": camera.height,
        "step": step,
        "columns": kept["depth"].shape[1],
        "depth_low_m": depth_low,
        "depth_step": DEPTH_STEP,
        "sigma_low_m": sigma_low,
        "sigma_step": SIGMA_STEP,
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "words": WORDS,
        "kinds": NAMES,
        "most_pairs": MOST_PAIRS,
        "T_home_cam": reference.T_home_cam[:3].tolist(),
        "origin_m": result.origin_m.tolist(),
        "is_level": reference.is_level,
    }
    colour, low, high = depth_colours(result.depth)
    stops = ", ".join(to_hex(c) for c in colour(np.geomspace(low, high, _STOPS)))
    ticks = tuple(f"{v:.3g} m" for v in np.geomspace(low, high, 5))
    drawn = (colour(drawn_values(result.depth))[..., :3] * 255).astype(np.uint8)
    return PixelView(
        picture=_jpeg(drawn_picture(reference.image)),
        depth=_jpeg(drawn),
        colours=stops,
        ticks=ticks,
        about=packed(json.dumps(about).encode()),
        depth_codes=packed(depth_codes.tobytes()),
        sigma_codes=packed(sigma_codes.tobytes()),
        kind_codes=packed(np.ascontiguousarray(kept["kind"]).tobytes()),
    )


def log_codes(values: np.ndarray, step: float):
    """Codes (uint16, little-endian) of positive values, and the least value: low · exp((code - 1) ·
    step); 0 is none.

    >>> codes, low = log_codes(np.array([2.0, np.nan, 2.0 * np.e]), 0.01)
    >>> codes.tolist(), low
    ([1, 0, 101], 2.0)
    """
    known = np.isfinite(values) & (values > 0)
    low = float(values[known].min()) if known.any() else 1.0
    codes = np.zeros(values.shape, "<u2")
    codes[known] = np.minimum(np.rint(np.log(values[known].astype(float) / low) / step) + 1, 65535)
    return codes, low


def _jpeg(image: np.ndarray) -> str:
    data = io.BytesIO()
    Image.fromarray(image).save(data, format="jpeg", quality=88)
    return base64.b64encode(data.getvalue()).decode()
