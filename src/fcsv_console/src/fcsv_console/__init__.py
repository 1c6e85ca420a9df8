# SPDX-License-Identifier: Apache-2.0
"""What the operator sees: one view-model without Qt and ROS (model/), and thin layers that feed and
show it."""
