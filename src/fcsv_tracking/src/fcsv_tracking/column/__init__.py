# SPDX-License-Identifier: Apache-2.0
"""The column of vehicles is calibrated: where each odometry began, seen from another's."""
