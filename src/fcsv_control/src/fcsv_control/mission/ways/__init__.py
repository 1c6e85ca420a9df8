# SPDX-License-Identifier: Apache-2.0
"""Where vehicles go, and ways that keep clear of the others."""
