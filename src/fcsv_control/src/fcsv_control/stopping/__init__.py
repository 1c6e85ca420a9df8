# SPDX-License-Identifier: Apache-2.0
"""Stops or lands everybody, without the mission."""
