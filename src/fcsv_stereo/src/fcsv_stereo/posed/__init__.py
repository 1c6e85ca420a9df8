# SPDX-License-Identifier: Apache-2.0
"""Posed photographs as input of a map: COLMAP's text model, how well poses are known, scale and
origin."""
