# SPDX-License-Identifier: Apache-2.0
"""What must be true before take-off: a table of lines with states and remedies
(docs/user/flight_check.md)."""
