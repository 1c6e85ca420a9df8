# SPDX-License-Identifier: Apache-2.0
"""An autopilot that speaks MAVLink 2 as ArduCopter 4.3 does on external navigation, refusals
included."""
