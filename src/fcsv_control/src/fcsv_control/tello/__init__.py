# SPDX-License-Identifier: Apache-2.0
"""A Tello flown by position: what an autopilot does elsewhere is done here, on the control PC
(thesis 4.3, 5.3)."""
