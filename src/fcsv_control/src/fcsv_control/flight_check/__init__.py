# SPDX-License-Identifier: Apache-2.0
"""What must be true before take-off: a table of lines, green, amber or red, with what to do (docs/flight_check.md)."""
