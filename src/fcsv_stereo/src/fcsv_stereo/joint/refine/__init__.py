# SPDX-License-Identifier: Apache-2.0
"""Sub-pixel depth, and poses aligned to the pictures."""
