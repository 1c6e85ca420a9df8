# SPDX-License-Identifier: Apache-2.0
"""Parameters of autopilot and link."""
