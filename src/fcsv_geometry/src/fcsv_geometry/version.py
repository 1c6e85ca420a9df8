# SPDX-License-Identifier: Apache-2.0
"""The version of fcsv; tools/version.py writes it here from the file VERSION."""

VERSION = "0.6.0"
