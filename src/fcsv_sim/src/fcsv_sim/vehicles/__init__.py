# SPDX-License-Identifier: Apache-2.0
"""Motion of multirotors and Tellos."""
