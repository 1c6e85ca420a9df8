# SPDX-License-Identifier: Apache-2.0
"""Commands of fcsv_control for a desk."""
