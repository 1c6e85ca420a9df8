# SPDX-License-Identifier: Apache-2.0
"""The simulated town: procedural, seeded, in metres; world frame x forward (into the town), y left,
z up."""
