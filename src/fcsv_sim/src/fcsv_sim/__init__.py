# SPDX-License-Identifier: Apache-2.0
"""What stands in for hardware: world, cameras, vehicles, autopilot, operator."""
