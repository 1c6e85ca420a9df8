# SPDX-License-Identifier: Apache-2.0
"""A map against truth and by points of interest."""
