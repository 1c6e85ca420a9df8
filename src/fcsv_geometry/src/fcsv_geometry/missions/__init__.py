# SPDX-License-Identifier: Apache-2.0
"""The mission file, and what it says of places, limits, fence and separation."""
