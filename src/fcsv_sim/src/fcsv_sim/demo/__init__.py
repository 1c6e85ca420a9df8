# SPDX-License-Identifier: Apache-2.0
"""The main job in simulation: a master per machine, a flown mission, a map."""
