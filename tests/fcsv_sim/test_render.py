# SPDX-License-Identifier: Apache-2.0
"""Pictures and depth against what geometry says; tags against where they truly are; edges against
fine sampling."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.vehicles.vehicle import Mount, VehicleGeometry
from fcsv_sim.render.bodies import RenderedBody, sample_offsets
from fcsv_sim.render.caster import EmbreeCaster, Open3dCaster
from fcsv_sim.render.rays import PRIM, T, ray_buffer, set_rays
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.world.materials import CONCRETE, GROUND
from fcsv_sim.world.mesh import MeshBuilder, Placement
from fcsv_sim.world.plan import TownPlan
from fcsv_sim.world.town import Town
from fcsv_tracking.tags import TagDetector

PINHOLE = PinholeCamera.from_fov(640, 480, np.radians(56))
DISTORTED = CameraParameters().model
FORWARD = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
AHEAD = Mount((0.0, 0.0, 0.0))


def vehicle(tag_id=1):
    return VehicleGeometry(
        f"uav{tag_id}", tag_id, tag_id, 0.16, AHEAD, AHEAD, Mount((-0.16, 0, 0.02), (0, 0, 180.0))
    )


def looking_ahead(x, y, z, rpy=(0, 0, 0)):
    return transforms.from_xyz_rpy([x, y, z], rpy) @ FORWARD


@pytest.fixture(scope="module")
def plain():
    """A flat ground and one box, 4 x 6 x 5 m, its front at x = 30 m."""
    mesh = MeshBuilder()
    ground = np.array([[[-900, -900, 0], [900, -900, 0], [900, 900, 0], [-900, 900, 0]]], float)
    mesh.faces(ground, GROUND, mesh.instance([0.1, 0.1, 0.1]))
    mesh.box(Placement(0, 0, 0), [30, -3, 0], [34, 3, 5], CONCRETE, mesh.instance([0.4, 0.4, 0.4]))
    return Renderer(Town(0, TownPlan.draw(np.random.default_rng(0)), *mesh.build()))


@pytest.fixture(scope="module")
def town():
    return Renderer(Town.generate(2))


@pytest.mark.parametrize("camera", [PINHOLE, DISTORTED], ids=["pinhole", "distorted"])
def test_depth_is_that_of_the_plane_and_the_box(plain, camera):
    T_world_cam = looking_ahead(1.0, 0.5, 8.0, (0.01, 0.05, -0.03))
    _, depth = plain.render(T_world_cam, camera)
    rays = camera.rays() @ T_world_cam[:3, :3].T
    p = T_world_cam[:3, 3]
    with np.errstate(divide="ignore"):
        ground = np.where(rays[..., 2] < 0, -p[2] / rays[..., 2], np.nan)
        front = (30.0 - p[0]) / rays[..., 0]
    hit = p + front[..., None] * rays
    inside = (np.abs(hit[..., 1]) < 2.9) & (hit[..., 2] > 0.1) & (hit[..., 2] < 4.9)
    expected = np.where(inside, front, ground)
    near_box = (np.abs(hit[..., 1]) < 4) & (hit[..., 2] > -0.2) & (hit[..., 2] < 8) & ~inside
    check = np.isfinite(expected) & (expected < 400) & ~near_box
    assert inside.sum() > 1000 and check.sum() > 100_000
    # single precision of ray and mesh: 1e-7 of hundreds of metres over the sine of a flat ray's
    # angle
    assert np.abs(depth[check] / expected[check] - 1).max() < 2e-4
    assert np.isnan(depth[0]).all()


def test_embree_and_open3d_agree():
    random = np.random.default_rng(3)
    vertices = random.uniform(-1, 1, (600, 3)).astype(np.float32)
    triangles = np.arange(600).reshape(200, 3)
    origin = np.tile([0.0, 0.0, -5.0], (5000, 1))
    direction = np.column_stack([random.uniform(-0.3, 0.3, (5000, 2)), np.ones(5000)])
    results = []
    for caster in (EmbreeCaster(vertices, triangles), Open3dCaster(vertices, triangles)):
        rays = ray_buffer(5000)
        set_rays(rays, origin, direction)
        caster.cast(rays)
        results.append((rays[:, T].copy(), rays.view(np.uint32)[:, PRIM].copy()))
    same = results[0][1] == results[1][1]
    assert same.mean() > 0.999  # a ray through an edge may take either side
    hit = same & np.isfinite(results[0][0])
    assert 0.2 < hit.mean() < 0.99
    assert np.allclose(results[0][0][hit], results[1][0][hit], rtol=1e-5)
    assert (results[0][1][np.isinf(results[0][0])] == 0xFFFFFFFF).all()


def fine(renderer, T_world_cam, camera, times=4):
    """The picture with times x times rays a pixel."""
    shift = (times - 1) / 2
    big = replace(
        camera,
        width=camera.width * times,
        height=camera.height * times,
        fx=camera.fx * times,
        fy=camera.fy * times,
        cx=camera.cx * times + shift,
        cy=camera.cy * times + shift,
    )
    values, _ = renderer.values(T_world_cam, big, samples=1)
    return values.reshape(camera.height, times, camera.width, times, 3).mean((1, 3))


def test_edges_are_antialiased(town):
    """Against 16 rays a pixel: what is left of the error after supersampling edges is texture, not
    stairs."""
    pose = looking_ahead(1, 0, 8)
    camera = PinholeCamera.from_fov(320, 240, np.radians(28))
    reference = fine(town, pose, camera)
    error = {n: np.abs(town.values(pose, camera, samples=n)[0] - reference) for n in (1, 3, 5)}
    edges = error[1].max(-1) > 0.1
    assert 0.02 < edges.mean() < 0.4
    assert error[5][edges].mean() < 0.55 * error[1][edges].mean()
    assert error[5][edges].mean() < error[3][edges].mean() < 0.7 * error[1][edges].mean()
    assert error[5].mean() < 0.03


def test_a_shift_of_a_tenth_of_a_pixel_changes_little(town):
    """Band-limited texture changes by about 0.1 of the difference between neighbours; aliasing by
    all of it."""
    pose = looking_ahead(1, 0, 8)
    a = town.render(pose, PINHOLE)[0].astype(float)
    b = town.render(pose, replace(PINHOLE, cx=PINHOLE.cx + 0.1))[0].astype(float)
    neighbours = np.abs(np.diff(a, axis=1)).mean()
    change = np.abs(a - b)
    assert change.mean() < 0.3 * neighbours
    assert (change.max(-1) > 40).mean() < 0.01


def test_the_same_pose_gives_the_same_picture(town):
    pose = looking_ahead(2, 1, 9)
    assert np.array_equal(town.render(pose, DISTORTED)[0], town.render(pose, DISTORTED)[0])


def test_tags_are_found_where_they_are(town):
    """At 3.5 m a tag is 27 px wide. The detector (pixel centres at 0.5) must show no bias of the
    corners beyond 0.03 px in any direction or in size, and a scatter like that of real pictures,
    about 0.1 px."""
    random = np.random.default_rng(4)
    camera, h = SimulatedCamera(town, FORWARD, CameraParameters(), 1), 0.08
    detector, front = TagDetector({1: 2 * h}), vehicle()
    # lb, rb, rt, lt: y is down
    corners_tag = np.array([[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0]])
    errors, outward = [], []
    for i in range(30):
        T_world_body = transforms.from_xyz_rpy(
            [0, 0, 8] + random.normal(0, 0.2, 3), random.normal(0, 0.03, 3)
        )
        T_world_front = transforms.from_xyz_rpy(
            [3.5, 0, 8] + random.normal(0, 0.25, 3), random.normal(0, 0.08, 3)
        )
        shot = camera.shoot(0.2 * i, T_world_body, [RenderedBody(front, T_world_front)], samples=1)
        found = detector.detect(cv2.cvtColor(shot.rgb, cv2.COLOR_RGB2GRAY), camera.model)
        assert [d.id for d in found] == [1]
        T_cam_tag = transforms.invert(shot.T_world_cam) @ T_world_front @ front.T_body_tag
        true = camera.model.project(transforms.apply(T_cam_tag, corners_tag))
        errors.append(found[0].corners_px - true)
        out = true - true.mean(0)
        outward.append((errors[-1] * out).sum(1) / np.linalg.norm(out, axis=1))
    errors = np.array(errors)
    # 30 x 4 corners of 0.08 px: the mean is known to 0.007 px
    assert np.abs(errors.mean((0, 1))).max() < 0.035
    assert abs(np.mean(outward)) < 0.03
    assert 0.02 < errors.std((0, 1)).max() < 0.12


def test_a_vehicle_hides_what_is_behind_it_and_is_hidden_by_what_is_in_front(plain):
    detector = TagDetector({1: 0.16, 2: 0.16})
    pose = looking_ahead(0, 0, 2.5)

    def seen(*bodies):
        rgb, depth = plain.render(pose, PINHOLE, bodies=bodies)
        return sorted(
            d.id for d in detector.detect(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), PINHOLE)
        ), depth

    def at(x, y, tag_id):
        return RenderedBody(vehicle(tag_id), transforms.from_xyz_yaw([x, y, 2.48], 0.0))

    assert seen(at(4, 0, 2))[0] == [2]
    ids, depth = seen(at(4, 0, 2), at(2.5, 0, 1))
    assert ids == [1]
    assert abs(depth[240, 320] - (2.5 - 0.16)) < 2e-3
    assert seen(at(4, 0, 2), at(2.5, 0.6, 1))[0] == [1, 2]
    ids, depth = seen(at(36, 0, 2))  # behind the box
    assert ids == [] and np.array_equal(depth, seen()[1], equal_nan=True)
    assert np.array_equal(seen(at(-3, 0, 2))[1], seen()[1], equal_nan=True)  # behind the camera


def test_samples_in_a_pixel_are_centred_and_use_every_row_and_column():
    offsets = sample_offsets(16)
    assert np.allclose(offsets.mean(0), 0.0)
    assert all(
        len(np.unique(offsets[:, k])) == 16 and np.abs(offsets[:, k]).max() < 0.5 for k in (0, 1)
    )


def test_what_is_no_pose_or_no_quality_is_refused(plain):
    broken = looking_ahead(0, 0, 5)
    broken[0, 3] = np.nan
    with pytest.raises(GeometryError, match="T_world_cam"):
        plain.render(broken, PINHOLE)
    with pytest.raises(ValueError, match="samples"):
        plain.render(looking_ahead(0, 0, 5), PINHOLE, samples=2)
