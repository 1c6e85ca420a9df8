# SPDX-License-Identifier: Apache-2.0
"""The recorder as a node."""
