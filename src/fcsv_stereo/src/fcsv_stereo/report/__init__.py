# SPDX-License-Identifier: Apache-2.0
"""report.html: one page on which a person can judge a map."""

from fcsv_stereo.report.page import write_report

__all__ = ["write_report"]
