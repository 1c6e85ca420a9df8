# SPDX-License-Identifier: Apache-2.0
"""Any bag with pictures and poses of cameras, made into a folder that ``map`` reads:
``import_bag``.
"""

from fcsv_stereo.bag_import.importing import import_bag
from fcsv_stereo.bag_import.request import CameraRequest, ImportRequest

__all__ = ["CameraRequest", "ImportRequest", "import_bag"]
