# SPDX-License-Identifier: Apache-2.0
"""The command `parameters`: an autopilot's parameters compared with a profile, written, saved."""
