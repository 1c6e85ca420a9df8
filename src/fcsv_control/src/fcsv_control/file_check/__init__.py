# SPDX-License-Identifier: Apache-2.0
"""Configuration files, checked by the parsers that read them in flight."""
