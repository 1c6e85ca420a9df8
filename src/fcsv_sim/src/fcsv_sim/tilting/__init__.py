# SPDX-License-Identifier: Apache-2.0
"""A simulated tilting stereo camera (thesis 7.2) before thin things: power lines, a valve, a
branch."""
