# SPDX-License-Identifier: Apache-2.0
"""From posed pictures to depth, points, map and report."""
