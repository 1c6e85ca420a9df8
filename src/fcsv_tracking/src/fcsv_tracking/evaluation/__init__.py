# SPDX-License-Identifier: Apache-2.0
"""Trajectories as files that evo reads, and how far two of them are apart."""
