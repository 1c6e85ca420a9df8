# SPDX-License-Identifier: Apache-2.0
"""The flight link: MAVLink to an ArduCopter on external navigation, ENU and FLU on our side."""
