# SPDX-License-Identifier: Apache-2.0
"""The view-model on a terminal of 80 columns, for SSH: `rosrun fcsv_console status`."""
