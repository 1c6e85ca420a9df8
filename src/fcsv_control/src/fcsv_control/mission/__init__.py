# SPDX-License-Identifier: Apache-2.0
"""The mission of thesis 6.4: column, calibration, home, a list of stereo configurations,
landing."""
