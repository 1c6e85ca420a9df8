# SPDX-License-Identifier: Apache-2.0
"""The demo's own nodes: pair flights, watching the mission."""
