# SPDX-License-Identifier: Apache-2.0
"""External navigation for the autopilot, and whether it can be believed."""
