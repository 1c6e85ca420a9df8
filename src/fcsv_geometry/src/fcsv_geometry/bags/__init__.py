# SPDX-License-Identifier: Apache-2.0
"""Bags without ROS: messages of ROS 1 and ROS 2; of ROS 1 (version 2.0) the records, and the repair
of a cut one.

``reading`` gives messages. ``records`` reads records, ``salvage`` copies what is whole into a new
bag with an index, ``repair`` does so with files.
"""
