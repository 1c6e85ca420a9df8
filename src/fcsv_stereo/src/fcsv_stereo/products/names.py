# SPDX-License-Identifier: Apache-2.0
"""Names of the products and of their files."""

from typing import List

from fcsv_stereo.errors import InputError

#: product: its files and folders in OUT/
PRODUCTS = {
    "pcd": ("map.pcd",),
    "laz": ("map.laz",),
    "orthophoto": ("orthophoto.png", "orthophoto.pgw", "height.tif"),
    "colmap": ("colmap",),
    "pairs": ("pairs",),
    "ground": ("ground",),
}
#: what "all" stands for: ground is of one robot, and is named
ALL = tuple(name for name in PRODUCTS if name != "ground")
FILES = tuple(f for files in PRODUCTS.values() for f in files)


def parse_products(text: str) -> List[str]:
    """Names out of "pcd,laz" or "all"; none out of "". Raises InputError on a name that is not one.

    >>> parse_products("laz, pairs"), parse_products("")
    (['laz', 'pairs'], [])
    """
    names = [w.strip() for w in text.split(",") if w.strip()]
    if names == ["all"]:
        return list(ALL)
    for name in names:
        if name not in PRODUCTS:
            raise InputError(f"product '{name}' is not one of {', '.join(PRODUCTS)}, all")
    return [p for p in PRODUCTS if p in names]
