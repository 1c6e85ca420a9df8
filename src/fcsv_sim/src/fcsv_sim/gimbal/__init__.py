# SPDX-License-Identifier: Apache-2.0
"""Gimbal, its camera, a bus of Dynamixel servos."""
