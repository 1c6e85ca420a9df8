# SPDX-License-Identifier: Apache-2.0
"""All state of the console: facts with monotonic time go in, an immutable view comes out. No Qt, no
ROS, no clock."""
