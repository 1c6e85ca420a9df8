# SPDX-License-Identifier: Apache-2.0
"""Edges: which views are compared, and the similarity between two."""
