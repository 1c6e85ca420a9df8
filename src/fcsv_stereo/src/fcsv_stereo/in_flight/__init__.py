# SPDX-License-Identifier: Apache-2.0
"""Maps that grow in flight, depth that is monitored, and pictures that contradict trackers."""
