# SPDX-License-Identifier: Apache-2.0
"""Which depths count: reliability, sigma, sky, motion, contradiction between axes."""
