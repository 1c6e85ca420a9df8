# SPDX-License-Identifier: Apache-2.0
"""The agent on board: the only one that commands the flight link; a vehicle never depends on
another machine."""
