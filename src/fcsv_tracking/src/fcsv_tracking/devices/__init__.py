# SPDX-License-Identifier: Apache-2.0
"""Drivers, clocks and buses of cameras."""
