# SPDX-License-Identifier: Apache-2.0
"""Thesis chapter 5: a motion capture camera on the ground, and the vehicle's odometry where that
does not see it."""
