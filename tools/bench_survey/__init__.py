# SPDX-License-Identifier: Apache-2.0
"""make bench-survey: drawn sites, joined, against the truth; the table of docs/lab/survey.md."""
