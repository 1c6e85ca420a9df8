# SPDX-License-Identifier: Apache-2.0
"""Leads from maps of several views to one site: a similarity for each view, and one cloud of what
they see.

A later module imports earlier ones only: tuning, similarity, station, views, inputs, features,
matching, edges, adjust, earth, control_points, world, merge, georeference, document, page, octree,
rasters, maps, work, kept, survey, command.
"""
