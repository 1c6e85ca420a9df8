# SPDX-License-Identifier: Apache-2.0
"""Ways of the column above ground that a map knows."""

import math
import re

import numpy as np
import pytest
import rasterio
import yaml
from rasterio.crs import CRS
from rasterio.transform import Affine
from rasterio.warp import transform

from fcsv_control.file_check.checking import check
from fcsv_control.mission.plans import plan_check, plan_words
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.mission import load_mission

PAIR = ["uav1", "uav2"]
FIX = {"latitude_deg": 48.1, "longitude_deg": 11.6, "course_deg": 60.0}
DOCUMENT = {
    "name": "site",
    "configurations": [{"axis": "horizontal", "baseline_m": 3.0}],
    "stations": [
        {"name": "east", "place_m": [20.0, 0.0], "headings_deg": [0.0]},
        {"name": "north", "place_m": [20.0, 14.0], "headings_deg": [0.0]},
    ],
    "terrain": "ground.tif",
}


def ground(x, y, hill_m):
    """Takes off at 500 m; a hill stands between east and north, the east is not known far south."""
    height = 500.0 + hill_m * np.exp(-((x - 20.0) ** 2 + (y - 7.0) ** 2) / 8.0)
    return np.where(y < -12.0, np.nan, height).astype(np.float32)


def write(path, crs=None, hill_m=6.0, cell_m=0.5, half_m=40.0, at=(0.0, 0.0)):
    n = int(2 * half_m / cell_m)
    line = (np.arange(n) + 0.5) * cell_m - half_m
    x, y = np.meshgrid(line + at[0], line[::-1] + at[1])
    if crs is None:
        band, origin = ground(x, y, hill_m), (at[0] - half_m, at[1] + half_m)
        crs = CRS.from_user_input('LOCAL_CS["site",UNIT["metre",1]]')
    else:
        e0, n0 = (v[0] for v in transform("EPSG:4326", crs, [11.6], [48.1]))
        # a grid whose north differs from true north by two degrees: 0.7 m over 20 m
        c, s = math.cos(math.radians(60.0)), math.sin(math.radians(60.0))
        band = ground(c * y + s * x, s * y - c * x, hill_m)
        origin = (e0 - half_m, n0 + half_m)
    profile = {"driver": "GTiff", "dtype": "float32", "count": 1, "height": n, "width": n}
    to_world = Affine(cell_m, 0.0, origin[0], 0.0, -cell_m, origin[1])
    with rasterio.open(path, "w", crs=crs, transform=to_world, nodata=np.nan, **profile) as out:
        out.write(band, 1)
    return path


def planned(folder, **more):
    path = folder / "site.yaml"
    path.write_text(yaml.safe_dump({**DOCUMENT, **more}))
    return load_mission(path)


def wrong(m):
    return plan_check.check_plan(m, plan_check.on_the_ground(m, PAIR, {}))


@pytest.mark.parametrize("crs, more", [(None, {}), ("EPSG:32632", {"home_fix": FIX})])
def test_a_way_over_a_hill_is_refused_with_its_place(tmp_path, crs, more):
    write(tmp_path / "ground.tif", crs)
    m = planned(tmp_path, **more)
    [line] = [w for w in wrong(m) if "north" in w]
    assert re.match(
        r"way of the column to north at 0 deg: 2\.[01] m above the ground at \((19|20)\.\d, [5-8]\.\d\) m in home, 3 m",
        line,
    )
    low = planned(tmp_path, terrain_clearance_m=1.0, **more)
    assert not any("above the ground" in w for w in wrong(low))
    words = plan_words.stations_in_words(low, PAIR)
    # cells of half a metre, of which the highest about a place counts
    assert re.search(
        r"east at 0 deg .* \((7\.[89]|8\.0) m above ground\), north .* \(2\.[01] m above", words
    )
    assert "not known" not in words


def test_the_fence_s_floor_counts_from_the_ground_too(tmp_path):
    write(tmp_path / "ground.tif")
    m = planned(tmp_path, terrain_clearance_m=0.0, fence={"floor_m": 2.5})
    assert any("2.5 m at least" in line for line in wrong(m))


def test_ground_that_is_not_known_is_said(tmp_path):
    write(tmp_path / "ground.tif", hill_m=0.0, half_m=16.0, at=(0.0, -4.0))
    m = planned(tmp_path)
    assert not wrong(m)
    words = plan_words.stations_in_words(m, PAIR)
    assert "(8.0 m above ground, partly not known)" in words
    none = planned(tmp_path, terrain=None)
    assert none.ground is None and not wrong(none)
    assert "height above the ground not known (no terrain)" in plan_words.stations_in_words(
        none, PAIR
    )


def test_files_that_are_none_are_named(tmp_path):
    with pytest.raises(ConfigError, match="site.yaml: terrain: .*ground.tif cannot be read"):
        planned(tmp_path)
    write(tmp_path / "ground.tif", "EPSG:32632")
    with pytest.raises(ConfigError, match="is in EPSG:32632: give the mission's home_fix, too"):
        planned(tmp_path)
    found = check(tmp_path / "site.yaml")
    assert "home_fix" in str(found)
    write(tmp_path / "ground.tif", at=(300.0, 0.0))
    with pytest.raises(ConfigError, match="does not know the ground at home"):
        planned(tmp_path)
    with pytest.raises(ConfigError, match="terrain_clearance_m: -1.0 must not be negative"):
        planned(tmp_path, terrain_clearance_m=-1.0)
    with pytest.raises(ConfigError, match="terrain"):
        planned(tmp_path, terrain=3)
