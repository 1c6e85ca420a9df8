# SPDX-License-Identifier: Apache-2.0
"""The list, and whether it can be flown."""
