# SPDX-License-Identifier: Apache-2.0
"""What a relay sends, takes, repeats, orders and measures."""
