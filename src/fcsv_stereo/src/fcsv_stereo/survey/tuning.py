# SPDX-License-Identifier: Apache-2.0
"""Tuned numbers of the survey, each with unit and source ("assumed" where nothing measured it)."""

#: rad: roll and pitch of a level home, which gravity gives. Assumed: twice what trackers reach in
#: flight.
LEVEL_RAD = 0.01
#: Share: scale of a map whose input says nothing of it. Flown maps have 1.0 to 1.7 % rms
#: (docs/lab/sigma.md).
SCALE = 0.02
#: m, share of the distance from home, rad: how well the trackers of a flight from stations know where
#: a reference was. Trackers drift by 0.05 m about home and 1 % of the way; heading as POSED_RAD.
FLOWN_M, FLOWN_SHARE, FLOWN_RAD = 0.05, 0.01, 0.0052
#: m, rad: what holds the first view where no view has a place: small against every edge.
ANCHOR_M, ANCHOR_RAD = 1e-3, 1e-5
#: m, rad: instead of "unknown" in a prior that starts at the place that the edges gave.
FREE_M, FREE_RAD = 1e3, 3.0

#: Most features of a picture; those of a 640x480 picture of a town are about 1,500.
MOST_FEATURES = 4000
#: Of a feature's depth: its sigma over its depth is at most this. What is less sure tells no scale.
MOST_FEATURE_SIGMA = 0.06
#: Depths in a feature's 5x5 pixels differ by at most so much, as a share: else it lies on an edge.
#: Assumed.
MOST_FEATURE_STEP = 0.04
#: px: standard deviation of a feature's place in a picture seen from elsewhere. Residuals of drawn
#: sites are 0.7 to 1.
FEATURE_PX = 1.0
#: Lowe's ratio of the best to the second best distance: with a prior's gate, and without one.
RATIO_GATED, RATIO_FREE = 0.85, 0.8
#: Standard deviations of the priors, and px besides, within which a match is looked for.
GATE_SIGMAS, GATE_PX = 3.5, 15.0

#: Pixels of a view, about so many, that tell by the priors whether two views overlap, and the least
#: share of them.
OVERLAP_SAMPLES, LEAST_OVERLAP = 1500, 0.05
#: Views that a view is compared with at least. In a ring of 24, 6 give all edges that all pairs give.
NEIGHBOURS = 8
#: Cosine of the angle between two views' rays to a point, and ratio of its distances, up to which its
#: surroundings are tracked from one to the other; least share of such points; px: how far a corner
#: may come back from where it was.
LEAST_ALIKE_COSINE, MOST_ALIKE_RATIO, LEAST_ALIKE, MOST_TRACK_PX = 0.7, 2.0, 0.1, 1.0
#: Three matches at a time are drawn so often; they are scored with so many matches; so many starts
#: are refined.
DRAWS, SCORED, REFINED_DRAWS = 600, 100, 8
#: px: what a place may be off beside the points' own covariances, from a start of three matches to
#: the end.
TOLERANCES_PX = (24.0, 12.0, 5.0, 2.0, 0.0, 0.0)
#: Squared Mahalanobis distance of a match that counts: 99.5 % of three degrees of freedom.
MOST_CHI2 = 12.8
#: Fewest matches of an edge, and their least share. 12 wrong matches do not fit one similarity by
#: chance.
LEAST_MATCHES, LEAST_SHARE = 12, 0.12
#: What an edge must be known to: share of scale, rad.
MOST_EDGE_SCALE, MOST_EDGE_RAD = 0.03, 0.02
#: Most scale of one view against another, as a factor. Assumed; a model in feet or of no unit is
#: beyond it.
MOST_RATIO = 1.4
#: Share of a depth's variance that all of a picture's depths have in common beside their scale
#: (docs/lab/survey.md).
COMMON_SHARE = 0.02

#: Probability at which graduated non-convexity keeps a right edge (chi-square of seven degrees of
#: freedom).
KEPT_P = 0.9999
#: m: distance at which a view's turn and scale count as much as its place in what a site is as a whole
#: (30 to 200 m: all sigmas within 2 %).
DATUM_M = 60.0
#: Share: a view whose scale is so far from the others' is said, and its prior of scale has no say.
#: Flown: 1.0 to 1.7 %.
MOST_SCALE_OFF = 0.04

#: Depths of two views within so many standard deviations are of one surface; beyond the second one
#: sees through.
AGREE_SIGMAS, THROUGH_SIGMAS = 2.0, 3.5
#: Share of the depth: sigma of a point of the cloud is at most this, as in ``map``'s.
MOST_CLOUD_SIGMA = 0.2
#: Cosine of the angle between two rays from which on their depths are averaged; at a larger angle
#: they only agree.
LEAST_COSINE = 0.7
#: px; of a point's sigma: share of the map's, share of the bend of its surface within so many pixels,
#: most of that bend in the map's sigmas (more is a step), factor where one pair alone tells the depth,
#: share of what the view's covariance states: edges err by 0.4 to 0.9 of theirs. By coverage on drawn
#: sites (docs/lab/survey.md).
BEND_PX, PLANE_SIGMA, BEND_SIGMA, MOST_BEND, ONE_PAIR_SIGMA = 4, 0.15, 0.6, 4.0, 2.0
POSE_SIGMA = 0.8

#: px: side of the window about a control point's mark whose median depth counts, and sigma (m) of
#: a control point's coordinates where the user states none: of a receiver with corrections.
MARK_WINDOW_PX, CONTROL_SIGMA_M = 3, 0.02
#: rad, share: how a frame of stations may be tilted and stretched against the earth's. Assumed:
#: the plumb line's deflection, and what a metre is.
STATIONS_TILT_RAD, STATIONS_SCALE = 1e-3, 1e-3
#: Share of a scale beyond which a model's unit of length is no metre, and its prior of scale has no
#: say; that prior then is so wide.
MOST_METRE_OFF, FREE_SCALE = 0.2, 20.0
#: Standard deviations of their places within which two fixes count as one place.
APART_SIGMAS = 3.0
#: Standard deviations in an axis from which on a control point's residual is marked: 0.8 % of right
#: points are.
UNLIKELY_SIGMAS = 3.0
#: Share of all statements on the world that may be thrown out as wrong.
MOST_WRONG = 0.4

#: rad, share of the distance, share: how well the model of a folder of photographs states one of its
#: poses against the next, and how alike two of its maps are in scale. The first two are ``map``'s.
POSED_RAD, POSED_SHARE, POSED_SCALE = 0.0052, 0.01, 0.01
