# SPDX-License-Identifier: Apache-2.0
"""Leads from maps to the ground that a robot can drive on, and the route across it."""
