# SPDX-License-Identifier: Apache-2.0
"""ROS side of fcsv_guidance: nodes and message handling; the algorithms are one level up."""
