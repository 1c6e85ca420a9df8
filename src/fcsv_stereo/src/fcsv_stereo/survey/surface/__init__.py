# SPDX-License-Identifier: Apache-2.0
"""One surface of many depths: points that are joined along their rays, and the forms of what they
make."""
