# SPDX-License-Identifier: Apache-2.0
"""What other programs go on from: clouds, a height map and an orthophoto, a COLMAP model, rectified
pairs, ground for a robot."""

from fcsv_stereo.products.ground import check_robot
from fcsv_stereo.products.names import ALL, FILES, PRODUCTS, parse_products
from fcsv_stereo.products.write import write_products

__all__ = ["ALL", "FILES", "PRODUCTS", "check_robot", "parse_products", "write_products"]
