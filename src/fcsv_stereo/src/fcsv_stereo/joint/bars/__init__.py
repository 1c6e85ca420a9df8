# SPDX-License-Identifier: Apache-2.0
"""Straight thin things (conductors, rails, limbs) matched as wholes, by their edges from end to
end.

A window of pixels about a thing of some pixels shows mostly what is behind it. Reached:
docs/lab/tilting.md.
"""

from fcsv_stereo.joint.bars.edges import Edges, find_edges
from fcsv_stereo.joint.bars.join import with_bars
from fcsv_stereo.joint.bars.match import MatchedEdges, match_edges

__all__ = ["Edges", "MatchedEdges", "find_edges", "match_edges", "with_bars"]
