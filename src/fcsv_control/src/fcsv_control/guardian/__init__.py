# SPDX-License-Identifier: Apache-2.0
"""The guardian on board: the only one besides the pilot that may take a vehicle from the mission;
needs no other machine."""
