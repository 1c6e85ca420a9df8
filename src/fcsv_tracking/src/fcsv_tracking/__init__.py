# SPDX-License-Identifier: Apache-2.0
"""Where every camera is: tags, calibration of neighbouring vehicles, home, tf."""
