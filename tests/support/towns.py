# SPDX-License-Identifier: Apache-2.0
"""The town of seed 1 with its renderer, made once in each process of a test run: it takes four
seconds, and pictures do not depend on what was rendered before."""

import functools

from fcsv_sim.render.renderer import Renderer
from fcsv_sim.world.town import Town


@functools.lru_cache(maxsize=None)
def street_renderer() -> Renderer:
    return Renderer(Town.generate(1, "street"))
