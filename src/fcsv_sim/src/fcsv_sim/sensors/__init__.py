# SPDX-License-Identifier: Apache-2.0
"""Camera, depth camera, T265, Tello sensors, V120 Duo."""
