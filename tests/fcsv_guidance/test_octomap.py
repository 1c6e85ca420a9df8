# SPDX-License-Identifier: Apache-2.0
"""OctoMaps of drawn scenes, read back by the library and by Debian's octomap-tools."""

import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

from fcsv_guidance.errors import GroundError, GuidanceError
from fcsv_guidance.files.octomap_files import write_octomap

VOXEL_M = 0.2
BOX = (13.0, 15.0, -2.0, 1.0, 0.0, 1.6)
FREE, OCCUPIED, UNKNOWN = 0, 1, -1


@pytest.fixture(scope="module")
def octomap():
    return pytest.importorskip("pyoctomap", reason="pyoctomap is not installed (requirements.txt)")


@pytest.fixture
def tool():
    """tool(name, arguments...): what a program of Debian's octomap-tools prints; skipped where it
    is missing."""

    def run(name, *arguments):
        if shutil.which(name) is None:
            pytest.skip(f"{name} is missing: apt install octomap-tools")
        done = subprocess.run(
            [name, *map(str, arguments)], capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    return run


def tree_of(octomap, path):
    tree = octomap.OcTree(0.1)
    assert tree.readBinary(str(path))
    return tree


def state(tree, xyz_m):
    """FREE, OCCUPIED or UNKNOWN at a place."""
    return int(tree.getLabels(np.array([xyz_m], float))[0])


def test_free_along_rays_occupied_at_surfaces_and_unknown_behind(octomap, scene, tmp_path):
    bt, _ = write_octomap([scene([BOX]).view()], tmp_path, "map", VOXEL_M)
    tree = tree_of(octomap, bt)
    assert tree.getResolution() == VOXEL_M
    assert state(tree, (9.0, 0.1, 4.3)) == FREE  # between camera and ground
    # its face; ground
    assert state(tree, (13.05, -0.5, 0.9)) == OCCUPIED and state(tree, (10.0, 3.1, 0.0)) == OCCUPIED
    assert state(tree, (14.1, -0.5, 0.7)) == UNKNOWN  # inside of it
    assert state(tree, (16.1, -0.5, 0.3)) == UNKNOWN  # hidden behind it
    assert state(tree, (10.0, 3.1, -0.9)) == UNKNOWN and state(tree, (-3.0, 0.1, 4.1)) == UNKNOWN


def test_what_has_no_depth_stays_unknown_and_a_lone_wrong_pixel_frees_nothing(
    octomap, scene, tmp_path
):
    view = scene(blank=[(12, 16, -9, 9)]).view()
    view.depth[5, 5], view.sigma[5, 5], view.kind[5, 5] = 55.0, 0.01, 2  # through the sky
    tree = tree_of(octomap, write_octomap([view], tmp_path, "map", VOXEL_M)[0])
    assert state(tree, (14.1, 0.1, 0.1)) == UNKNOWN and state(tree, (14.1, 0.1, 0.5)) == UNKNOWN
    ray = np.array([(5 - view.K[0, 2]) / view.K[0, 0], (5 - view.K[1, 2]) / view.K[1, 1], 1.0])
    assert state(tree, view.T_home_cam[:3, :3] @ ray * 40.0 + view.T_home_cam[:3, 3]) == UNKNOWN


def test_noise_in_depth_frees_no_voxel_behind_a_wall(octomap, scene, tmp_path):
    """A wall across the picture, sigma 0.2 m at it: a ray frees a voxel that lies behind it by 0.1
    m and more where its error is above 2.5 sigma (0.6 %), and two of about 36 must (2 %), where
    none ends (these are most)."""
    wall = (20.0, 21.0, -40.0, 40.0, -1.0, 30.0)
    view = scene([wall]).view(noise=1.0, sigma_share=0.005)
    tree = tree_of(octomap, write_octomap([view], tmp_path, "map", VOXEL_M)[0])
    xyz = np.stack(
        np.meshgrid((20.1, 20.3, 20.5), np.arange(-5, 5, 0.2), np.arange(0.5, 8, 0.2)), -1
    ).reshape(-1, 3)
    assert (tree.getLabels(xyz) == FREE).mean() < 0.02


def test_two_views_know_more_and_a_surface_stands_against_one_ray(octomap, scene, tmp_path):
    front = scene([BOX]).view()
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    turned[0, 3] = 28.0
    mirrored = (13.0, 15.0, -1.0, 2.0, 0.0, 1.6)
    back = scene([mirrored]).view()
    back.T_home_cam[:] = turned @ back.T_home_cam  # the same box from behind
    tree = tree_of(octomap, write_octomap([front, back], tmp_path, "map", VOXEL_M)[0])
    assert state(tree, (16.1, -0.5, 0.3)) == FREE and state(tree, (14.1, -0.5, 0.7)) == UNKNOWN
    empty = scene().view()
    both = tree_of(octomap, write_octomap([front, empty], tmp_path, "both", VOXEL_M)[0])
    assert state(both, (13.05, -0.5, 0.9)) == OCCUPIED


def test_the_tools_of_debian_open_both_files(octomap, scene, tool, tmp_path):
    bt, ot = write_octomap([scene([BOX]).view()], tmp_path, "map", VOXEL_M)
    occupied = tree_of(octomap, bt).extractPointCloud()[0]
    shown = tool("bt2vrml", bt)
    written = int(re.search(r"Finished writing (\d+) voxels", shown).group(1))
    assert 0 < written <= len(occupied)  # leaves that are pruned are one voxel there
    tool("convert_octree", ot, tmp_path / "again.bt")
    again = tree_of(octomap, tmp_path / "again.bt")
    points = np.random.default_rng(1).uniform((5, -8, -1), (25, 8, 8), (4000, 3))
    assert np.array_equal(again.getLabels(points), tree_of(octomap, bt).getLabels(points))


def test_what_cannot_be_written_is_refused(octomap, scene, tmp_path, monkeypatch):
    view = scene().view()
    with pytest.raises(GroundError, match="take larger voxels"):
        write_octomap([view], tmp_path, "map", 0.001)
    with pytest.raises(GroundError, match="both must be above 0"):
        write_octomap([view], tmp_path, "map", 0.0)
    with pytest.raises(OSError, match="cannot be written"):
        write_octomap([view], tmp_path / "no folder", "map")
    monkeypatch.setitem(sys.modules, "pyoctomap", None)
    with pytest.raises(GuidanceError, match="pip install pyoctomap"):
        write_octomap([view], tmp_path, "map")
