# SPDX-License-Identifier: Apache-2.0
"""One ROS master per machine, selected topics between them."""
