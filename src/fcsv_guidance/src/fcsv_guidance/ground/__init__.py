# SPDX-License-Identifier: Apache-2.0
"""The ground model: from depth with sigma to cells and the probability that a robot can stand on them."""
