# SPDX-License-Identifier: Apache-2.0
"""What other programs go on from: clouds, a height map and an orthophoto, a COLMAP model, rectified pairs."""

from fcsv_stereo.products.names import FILES, PRODUCTS, parse_products
from fcsv_stereo.products.write import write_products

__all__ = ["FILES", "PRODUCTS", "parse_products", "write_products"]
