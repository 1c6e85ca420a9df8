# SPDX-License-Identifier: Apache-2.0
"""Simulated flights without ROS that measure the trackers."""
