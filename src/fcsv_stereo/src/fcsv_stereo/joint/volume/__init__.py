# SPDX-License-Identifier: Apache-2.0
"""Cost volume over inverse depth at a reduced size, and its minimum."""
