# SPDX-License-Identifier: Apache-2.0
"""Drives of a robot by simulated time, with faults, and what broke."""
