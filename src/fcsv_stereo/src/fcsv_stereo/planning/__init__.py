# SPDX-License-Identifier: Apache-2.0
"""What to fly: baselines, their effective ranges and trim points, and what the cameras will share
(thesis 3.2, 6.6)."""
