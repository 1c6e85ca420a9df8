# SPDX-License-Identifier: Apache-2.0
"""Rigid transforms, camera models, trajectories, strict configuration and message conversions."""
