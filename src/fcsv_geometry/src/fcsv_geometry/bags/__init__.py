# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1 (version 2.0) without ROS: their records, what a cut one still holds, and its repair.

``records`` reads records, ``salvage`` copies what is whole into a new bag with an index, ``repair`` does so with files.
"""
