# SPDX-License-Identifier: Apache-2.0
"""A ROS master per simulated machine, slow motion."""
