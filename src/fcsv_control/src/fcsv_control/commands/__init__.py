# SPDX-License-Identifier: Apache-2.0
"""What ``rosrun fcsv_control`` runs on a desk."""
