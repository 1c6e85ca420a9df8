# SPDX-License-Identifier: Apache-2.0
"""The town: the same for a seed, full of things at every range, free where vehicles fly."""

import numpy as np
import open3d as o3d
import pytest
from support.towns import street_renderer

from fcsv_geometry import transforms
from fcsv_sim.errors import SimulationError
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters
from fcsv_sim.world import command as world_command
from fcsv_sim.world import materials
from fcsv_sim.world.export import write_ply
from fcsv_sim.world.town import WORLDS, Town


@pytest.fixture(scope="module")
def town():
    return Town.generate(1)


def forward(x, y, z):
    return transforms.from_xyz_rpy([x, y, z], [0, 0, 0]) @ world_command.forward_camera()


def test_a_seed_is_a_town(town):
    again, other = Town.generate(1), Town.generate(2)
    for name in ("vertices", "triangles", "uv", "material", "instance", "parameters"):
        assert np.array_equal(getattr(town, name), getattr(again, name)), name
    assert other.vertices.shape != town.vertices.shape or not np.array_equal(
        other.vertices, town.vertices
    )


@pytest.mark.parametrize("world", sorted(set(WORLDS) - {"street"}))
def test_other_worlds(world):
    """Bounded, the same again, free where vehicles fly, depth at every range that equations are
    judged on."""
    made, again = Town.generate(1, world), Town.generate(1, world)
    assert np.array_equal(made.vertices, again.vertices) and np.array_equal(
        made.parameters, again.parameters
    )
    assert 300_000 < len(made.triangles) < 1_500_000
    assert np.isfinite(made.vertices).all() and made.triangles.max() == len(made.vertices) - 1
    assert made.instance.max() < len(made.parameters)
    v = made.vertices
    inside = (v[:, 0] > -55) & (v[:, 0] < 10) & (np.abs(v[:, 1]) < 30)
    assert np.abs(v[inside, 2]).max() < 1e-6
    depth = Renderer(made).render(forward(1, 0, 8), CameraParameters().model, samples=1)[1]
    seen = depth[np.isfinite(depth)]
    assert 0.12 < 1 - seen.size / depth.size < 0.35 and 8.0 < seen.min() < 16.0
    share = np.histogram(seen, [0, 20, 50, 100, 200, 400])[0] / seen.size
    assert share.min() > 0.03 and share.sum() > 0.75, share


def test_worlds_differ_in_texture():
    """The plain world is the one with little: less than half of the street's contrast on the ground
    and walls."""
    contrast = {}
    worlds = {"street": street_renderer(), "plain": Renderer(Town.generate(1, "plain"))}
    for world, renderer in worlds.items():
        picture, depth = renderer.render(forward(1, 0, 8), CameraParameters().model)
        grey = picture.mean(2)
        steps = np.abs(np.diff(grey, axis=1))[np.isfinite(depth[:, 1:])]
        contrast[world] = np.median(steps)
    assert contrast["plain"] < 0.5 * contrast["street"], contrast


def test_an_unknown_world_is_named():
    with pytest.raises(SimulationError, match="'moon' is not one of street, village, field, plain"):
        Town.generate(1, "moon")


def test_the_mesh_is_whole_and_of_a_size_that_can_be_rendered(town):
    assert 300_000 < len(town.triangles) < 1_500_000
    assert (
        np.isfinite(town.vertices).all()
        and np.isfinite(town.uv).all()
        and np.isfinite(town.parameters).all()
    )
    assert town.triangles.min() == 0 and town.triangles.max() == len(town.vertices) - 1
    assert len(town.material) == len(town.instance) == len(town.triangles)
    assert town.instance.max() < len(town.parameters)
    assert set(np.unique(town.material)) == set(range(materials.CONCRETE + 1))
    buildings = town.vertices[town.triangles[town.material == materials.FACADE].ravel()]
    assert (
        buildings[:, 0].max() > 450 and buildings[:, 1].min() < -200 and buildings[:, 1].max() > 200
    )


@pytest.mark.parametrize("seed", [1, 5, 7])
def test_nothing_stands_where_vehicles_fly(seed):
    """Columns start at x <= 0 and configurations reach 10 m to a side: the field is flat and empty
    up to x = 10 m."""
    town = Town.generate(seed)
    v = town.vertices
    assert len(town.triangles) < 1_500_000
    inside = (v[:, 0] > -55) & (v[:, 0] < 10) & (np.abs(v[:, 1]) < 30)
    assert np.abs(v[inside, 2]).max() < 1e-6


@pytest.mark.parametrize("seed", [3, 4])
def test_depth_at_all_ranges(seed):
    """What the mapping is judged on: sky a quarter of the picture, something at every distance up
    to the hills."""
    renderer = Renderer(Town.generate(seed))
    depth = renderer.render(forward(1, 0, 8), CameraParameters().model, samples=1)[1]
    seen = depth[np.isfinite(depth)]
    assert 0.15 < 1 - seen.size / depth.size < 0.32
    assert 8.0 < seen.min() < 16.0
    share = np.histogram(seen, [0, 20, 40, 80, 150, 250, 350, 450, 800])[0] / seen.size
    assert share.min() > 0.015, share
    assert (seen < 400).mean() > 0.75


def test_the_low_texture_wall_is_there(town):
    wall = town.vertices[town.triangles[town.material == materials.PLAIN_WALL].ravel()]
    assert 40 < wall[:, 0].mean() < 140 and wall[:, 2].max() - wall[:, 2].min() > 7


def test_ply_holds_the_same_mesh(town, tmp_path):
    write_ply(town, tmp_path / "scene.ply")
    mesh = o3d.io.read_triangle_mesh(str(tmp_path / "scene.ply"))
    assert np.array_equal(np.asarray(mesh.vertices).astype(np.float32), town.vertices)
    assert np.array_equal(np.asarray(mesh.triangles), town.triangles)
    assert not list(tmp_path.glob("*.part"))


def test_command_refuses_what_it_cannot_do(tmp_path, capsys):
    assert world_command.main(["--seed", "-1"]) == 2
    (tmp_path / "file").write_text("")
    assert world_command.main(["--ply", str(tmp_path / "file" / "scene.ply")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert (
        len(lines) == 2
        and "--seed" in lines[0]
        and f"{tmp_path / 'file'}: a file stands" in lines[1]
    )
    with pytest.raises(SimulationError, match="png"):
        world_command._write_picture(str(tmp_path / "a.txt"), np.zeros((2, 2, 3), np.uint8))
