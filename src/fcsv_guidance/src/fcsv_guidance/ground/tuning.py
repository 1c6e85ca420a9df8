# SPDX-License-Identifier: Apache-2.0
"""Tuned numbers of the ground model, each with unit, source and the range in which it does not
matter."""

#: A cell counts as free from this probability on: of those with 0.95 and more at least 95 % are
#: free in the truth, and few of those with 0.98 and more are not (docs/lab/guidance.md).
FREE_P = 0.98
#: Where one map says free and another gives less than this, the cell is uncertain.
CONTRADICTED_P = 0.85
#: Of standing.features: tools/train_ground.py, mazes and rubble, seeds 11 to 13, robot rescue.
STAND_WEIGHTS = (
    5.820,
    -0.460,
    0.000,
    -1.997,
    -0.709,
    0.000,
    0.000,
    -2.226,
    0.000,
    0.000,
    0.000,
    0.000,
    0.000,
    0.000,
    0.000,
    -1.765,
    0.000,
    0.000,
    0.000,
    0.000,
    0.000,
    0.000,
    -4.013,
    -3.150,
    -0.963,
    -1.140,
    0.000,
    0.000,
)
#: A known cell below this probability is an obstacle; between the two it is uncertain, and no route
#: crosses it.
OBSTACLE_P = 0.5
#: Shares of the step that a robot climbs beyond which ground does not count as free, by maps weighed
#: by number, and by maps judged together: little more is hardly seen (docs/lab/guidance.md).
STEP_SHARE, TOGETHER_SHARE = 0.8, 0.9
#: Standard deviations by which a slope or a beam must be beyond what a robot can: at 0 the noise of
#: far heights made half of the mazes' routes vanish (rehearse_robot, mazes 101 and 102).
BEYOND_SIGMAS = 2.0
#: Points in a cell without which it stays unknown. One wrong pixel must not make a cell. Assumed.
LEAST_POINTS = 2
#: m: a vertical gap of so much ends the lowest layer; what lies above it hangs over. Assumed: rows
#: of pixels on a wall lie 0.05 m apart at 30 m (f = 600 px).
LAYER_GAP_M = 0.2
#: m: how far a beam's lower edge may lie from a cell over which only its upper side is seen.
#: Assumed.
OVERHEAD_REACH_M = 0.3
#: The same at most, in cells: a smaller robot drives between lower and thinner things, which are
#: mapped on smaller cells. Of cells of 0.1 m it changes nothing. Assumed.
OVERHEAD_CELLS = 3
#: Where pixels lie apart, a cell's evidence is that of a coarser cell of so many cells a side, in
#: this order, of whose parts so large a share is known. A ditch or a shadow narrower than a quarter
#: of the coarser cell may lie in it.
COARSER_SIDES = (2, 4)
COARSER_SHARE = 0.74
#: Quantiles of the heights in a cell's lowest layer that stand for its lower and upper edge.
LOW_QUANTILE, HIGH_QUANTILE = 0.1, 0.9
#: Share of a pixel's variance that its neighbours in the cell have in common (errors of pose,
#: smoothing). Assumed.
COMMON_SHARE = 0.25
#: Share of pixels whose depth is wrong beyond what its sigma says, by one pair and by two or more.
#: Assumed.
GROSS_ONE_PAIR, GROSS_AGREED = 0.05, 0.01
#: The surface between two pixels of a column is spanned to this multiple of the distance on level
#: ground, and never beyond LONGEST_SPAN_M.
SPAN_FACTOR = 1.7
LONGEST_SPAN_M = 0.5
#: Weight of -log(p) against a metre of way.
RISK_M = 20.0
