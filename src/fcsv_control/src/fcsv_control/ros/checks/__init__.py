# SPDX-License-Identifier: Apache-2.0
"""The flight check and diagnostics as nodes and messages."""
