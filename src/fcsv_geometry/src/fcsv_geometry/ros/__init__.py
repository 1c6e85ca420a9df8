# SPDX-License-Identifier: Apache-2.0
"""ROS side of fcsv_geometry: nodes and message handling; the algorithms are one level up."""
