# SPDX-License-Identifier: Apache-2.0
"""The files of a map, and which of its points and pictures they hold."""
