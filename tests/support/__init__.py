# SPDX-License-Identifier: Apache-2.0
"""What several tests share: scenes, boards, simulated rigs, waiting, demos, and how a test run is
divided."""
