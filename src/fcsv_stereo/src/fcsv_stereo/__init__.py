# SPDX-License-Identifier: Apache-2.0
"""Leads from posed pictures to depth, points, map and report."""
