# SPDX-License-Identifier: Apache-2.0
"""A Tello's link as a node."""
