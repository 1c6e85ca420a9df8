# SPDX-License-Identifier: Apache-2.0
"""Where the robot is: by fixes, by tags on it, by gimbals on it, and by its wheels between."""
