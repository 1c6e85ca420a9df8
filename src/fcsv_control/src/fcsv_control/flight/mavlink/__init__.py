# SPDX-License-Identifier: Apache-2.0
"""MAVLink to and from an autopilot."""
