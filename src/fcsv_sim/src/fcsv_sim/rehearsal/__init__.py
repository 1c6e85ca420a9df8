# SPDX-License-Identifier: Apache-2.0
"""Flights without ROS, sockets and pictures, faster than real time: the cores that fly, on one
clock, with faults."""
