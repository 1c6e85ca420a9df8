# SPDX-License-Identifier: Apache-2.0
"""Photographs as cameras and COLMAP leave them, made into a folder that ``map`` reads:
``import_photos``."""

from fcsv_stereo.photos.importing import ImportOptions, import_photos

__all__ = ["ImportOptions", "import_photos"]
