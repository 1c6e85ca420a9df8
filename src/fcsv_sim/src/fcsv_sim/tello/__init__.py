# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello that speaks the real binary protocol over UDP
(docs/design/trackers.md#the-simulated-tello)."""
