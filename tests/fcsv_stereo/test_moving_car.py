# SPDX-License-Identifier: Apache-2.0
"""A car of the simulator's town that drives along the baselines as they grow: its motion looks like
parallax.

With one reference picture for all it cannot be told from a car at another depth (decision 8). A
session has a reference picture of every configuration: sigma must know, or the place is left out.
Boards do the same in test_faults.py.
"""

import numpy as np
import pytest
from support import faulty

from bench.scenes import FOV_DEG, R_BODY_CAM, T_WORLD_HOME
from fcsv_geometry import transforms
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.world import furniture
from fcsv_sim.world.mesh import MeshBuilder, Placement
from fcsv_sim.world.town import WORLDS, Town
from fcsv_stereo.joint import JointOptions, map_joint
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput, Picture
from fcsv_stereo.pipeline import METHODS

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

#: baseline (m), and how far the car has come by then: a quarter of the baseline, once it moves
FLIGHT = ((2.0, 0.0), (4.0, 1.0), (8.0, 2.0))
CAR_XY = (25.0, 1.0)  # on the crossing street, and along it
NOISE_RAD, HOVER_RAD = np.radians(0.15), np.radians(0.05)


def quiet(*_):
    pass


def town(car_y: float) -> Town:
    mesh = MeshBuilder()
    plan = WORLDS["street"](mesh, np.random.default_rng([1, 1]))
    place = Placement(CAR_XY[0], car_y, float(plan.height(CAR_XY[0], car_y)) + 0.02, np.pi / 2)
    furniture.car(mesh, place, np.random.default_rng(9))
    return Town(1, plan, *mesh.build())


@pytest.fixture(scope="module")
def flight():
    """Reference and other picture of each configuration, priors as flown; depth of the first
    reference, and the car."""
    parameters = CameraParameters(
        width=640, height=480, horizontal_fov_deg=FOV_DEG, distortion=(0.0,) * 5, mount_deg=0.0
    )
    renderers = {m: Renderer(town(CAR_XY[1] + m), 2) for m in (0.0, 1.0, 2.0)}
    cameras = {m: SimulatedCamera(r, R_BODY_CAM, parameters, 1) for m, r in renderers.items()}
    random = np.random.default_rng(5)

    def take(i, vehicle, xyz, moved, prior_rad, prior_m):
        T = transforms.from_xyz_rpy(
            xyz + random.normal(0.0, 0.03, 3), random.normal(0.0, np.radians(1.0), 3)
        )
        shot = cameras[moved].shoot(30.0 * i, T_WORLD_HOME @ T)
        error = transforms.from_xyz_rpy(
            random.normal(0.0, prior_m, 3), random.normal(0.0, prior_rad, 3)
        )
        T_home_cam = transforms.invert(T_WORLD_HOME) @ shot.T_world_cam @ error
        return Picture(
            f"{vehicle}/{i}", vehicle, 30.0 * i, shot.rgb, cameras[0.0].model, T_home_cam
        ), shot.depth

    pictures, first = [], None
    for i, (b, moved) in enumerate(FLIGHT):
        reference = take(i, "uav1", np.zeros(3), moved, HOVER_RAD * (i > 0), 0.005 * (i > 0))
        other = take(i, "uav2", np.array([0.0, -b, 0.0]), moved, NOISE_RAD, 0.01 * b / np.sqrt(3))
        pictures.append((reference[0], other[0]))
        first = first or reference
    behind = renderers[2.0].render(T_WORLD_HOME @ first[0].T_home_cam, first[0].camera)[1]
    return pictures, first[1], first[1] < 0.98 * behind


def false_claims(result, truth, on_car) -> float:
    """Share of the car's pixels that the map is sure of and wrong about."""
    sure, wrong = faulty.claims(result, truth, on_car)
    return sure * wrong / on_car.mean()


def test_a_car_that_drives_along_the_baselines(flight):
    pictures, truth, on_car = flight
    session = MapInput(
        "session",
        [
            ConfigurationInput(
                Configuration("horizontal", b, 0.0, f"horizontal {b:g} m"), [reference], [other]
            )
            for (b, _), (reference, other) in zip(FLIGHT, pictures)
        ],
    )
    assert on_car.sum() > 1000
    # matching alone: no easy case
    assert false_claims(map_joint(session, JointOptions(), quiet), truth, on_car) > 0.3
    result = METHODS["joint"].map(session, JointOptions(), quiet)
    assert false_claims(result, truth, on_car) <= faulty.MOST_WRONG
    assert any("something moved" in w for w in result.warnings), result.warnings
