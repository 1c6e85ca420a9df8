# SPDX-License-Identifier: Apache-2.0
"""The method ``joint``: depth from all pairs of all baselines and axes at once, with its standard deviation."""

from fcsv_stereo.joint.match import JointDepth, MatchOptions, match_jointly
from fcsv_stereo.joint.method import Joint, JointOptions, map_joint

__all__ = ["Joint", "JointDepth", "JointOptions", "MatchOptions", "map_joint", "match_jointly"]
