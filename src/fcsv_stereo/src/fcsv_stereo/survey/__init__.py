# SPDX-License-Identifier: Apache-2.0
"""Leads from maps of several views to one site: a similarity for each view, and one cloud of what
they see.

A later room imports earlier ones only: views, edges, placing, surface, document, tasks, output, survey,
command.
"""
