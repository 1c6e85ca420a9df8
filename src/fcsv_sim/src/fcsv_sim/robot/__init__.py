# SPDX-License-Identifier: Apache-2.0
"""A robot on the ground: what is seen of its place from above, its wheels, and rehearsals of its
drives."""
