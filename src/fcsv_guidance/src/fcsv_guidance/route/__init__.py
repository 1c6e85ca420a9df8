# SPDX-License-Identifier: Apache-2.0
"""Routes over known free ground, why there is none, and the robot that follows them."""
