# SPDX-License-Identifier: Apache-2.0
"""Calibration of cameras from pictures of a chessboard."""
