# SPDX-License-Identifier: Apache-2.0
"""What is done for the running configuration, as `stage` of fcsv_msgs/MissionState says it."""

MOVES = "moves"  # to its place
TURNS = "turns"  # about itself, to look round: no configuration is flown
HOLDS = "holds"  # until it is calm there, and recorders are on
RECORDS = "records"
FOLLOWS = "follows"  # all hold, or one goes where it is asked to; nothing is recorded
CALIBRATES = "calibrates"  # the column, at a station: no configuration is flown
GOES_BACK = "goes back"  # to the column: no configuration is flown
