# SPDX-License-Identifier: Apache-2.0
"""The method ``joint``: depth from all pairs of all baselines and axes at once, with its standard
deviation.

Its parts from the ground up; each imports only from those before it (``tests/house`` holds it):

- ``tuning`` (every tuned number), ``bands``, ``projecting``, ``views``, ``pictures``: what all stages stand on.
- ``volume``: the cost volume and the match that is taken from it.
- ``surfaces``: at a finer size, which of the surfaces about it a pixel belongs to.
- ``refine``: what the pictures say of a map; inverse depth between levels, exposures, poses.
- ``checks``: what may be relied on, its sigma, the sky; and what a finished map must pass.
- ``bars``: straight thin things, matched as wholes.
- ``match`` (the story from top to bottom), ``pairs`` and ``method`` (a map with its report).
"""

from fcsv_stereo.joint.match import JointDepth, MatchOptions, match_jointly
from fcsv_stereo.joint.method import Joint, JointOptions, map_joint

__all__ = ["Joint", "JointDepth", "JointOptions", "MatchOptions", "map_joint", "match_jointly"]
