# SPDX-License-Identifier: Apache-2.0
"""Child processes of the console: what takes long and needs no ROS here. They end with the
console."""
