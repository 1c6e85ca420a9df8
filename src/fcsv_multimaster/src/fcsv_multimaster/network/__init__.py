# SPDX-License-Identifier: Apache-2.0
"""Addresses, sessions and bytes between machines."""
