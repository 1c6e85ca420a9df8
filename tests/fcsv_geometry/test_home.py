# SPDX-License-Identifier: Apache-2.0
"""Home, calibration chain, odometry, extrinsics: composed in one place, from arrays and from
messages."""

import doctest

import numpy as np
import pytest

from fcsv_geometry import home, transforms
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.home import HomeFrames, OdomLink, camera_in_home, home_of

ROUNDING = 1e-9  # float64, a few products of numbers of order 100


def random_transform(random):
    return transforms.from_xyz_rpy(random.uniform(-20, 20, 3), random.uniform(-1, 1, 3))


def random_level(random):
    return transforms.from_xyz_yaw(random.uniform(-20, 20, 3), random.uniform(-3, 3))


class Fleet:
    """Three vehicles of one truth: where their odometries began, where they are, what links and
    home are true."""

    def __init__(self, seed):
        random = np.random.default_rng(seed)
        self.names = ["uav1", "uav2", "uav3"]
        self.T_world_odom = {n: random_level(random) for n in self.names}
        self.T_odom_body = {n: random_transform(random) for n in self.names}
        self.T_body_cam = {n: random_transform(random) for n in self.names}
        self.T_odom_home = home_of(self.T_odom_body["uav1"] @ self.T_body_cam["uav1"])
        self.T_world_home = self.T_world_odom["uav1"] @ self.T_odom_home

    def link(self, parent, child):
        T = transforms.invert(self.T_world_odom[parent]) @ self.T_world_odom[child]
        return OdomLink(parent, child, T, np.diag([1e-4, 1e-4, 1e-4, 1e-6]))

    def T_home_cam(self, name):
        T_world_cam = self.T_world_odom[name] @ self.T_odom_body[name] @ self.T_body_cam[name]
        return transforms.invert(self.T_world_home) @ T_world_cam


def test_identities_in_the_docstrings():
    result = doctest.testmod(home)
    assert result.attempted > 5 and result.failed == 0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "chain", [("uav1", "uav2", "uav3"), ("uav3", "uav2", "uav1"), ("uav2", "uav1", "uav3")]
)
def test_every_camera_of_the_chain_is_where_it_is(seed, chain):
    fleet = Fleet(seed)
    frames = HomeFrames()
    frames.calibrate([fleet.link(a, b) for a, b in zip(chain, chain[1:])][::-1])
    frames.set_home("uav1", fleet.T_odom_home)
    for name in fleet.names:
        found = camera_in_home(
            frames.T_home_odom[name], fleet.T_odom_body[name], fleet.T_body_cam[name]
        )
        assert np.allclose(found, fleet.T_home_cam(name), atol=ROUNDING)


def test_the_order_does_not_matter_and_the_newest_counts():
    fleet, links = Fleet(4), [Fleet(4).link("uav1", "uav2")]
    one, other = HomeFrames(), HomeFrames()
    one.calibrate(links)
    assert not one.places  # home is not known
    one.set_home("uav1", np.eye(4))
    one.set_home("uav1", fleet.T_odom_home)
    other.set_home("uav1", fleet.T_odom_home)
    assert not other.places  # a vehicle may be known only together with the others
    other.calibrate([])
    other.calibrate(links)
    assert list(one.places) == list(other.places) == ["uav1", "uav2"]
    assert all((one.T_home_odom[n] == other.T_home_odom[n]).all() for n in one.places)


def test_who_no_link_reaches_has_no_place():
    fleet, frames = Fleet(5), HomeFrames(alone=True)
    frames.set_home("uav1", fleet.T_odom_home)
    assert list(frames.places) == ["uav1"] and not frames.places["uav1"].covariance.any()
    frames.calibrate([fleet.link("uav2", "uav3")])
    assert list(frames.places) == ["uav1"]  # an unknown link is no identity


def test_from_messages():
    from fcsv_geometry.ros import conversions
    from fcsv_geometry.vehicles import home_messages
    from fcsv_msgs.msg import Calibration, CalibrationLink, Home

    fleet, frames = Fleet(6), HomeFrames()
    link = fleet.link("uav1", "uav2")
    message = CalibrationLink(
        parent="uav1", child="uav2", covariance=link.covariance.ravel().tolist()
    )
    message.child_odom_in_parent_odom = conversions.transform_to_pose(link.T_parent_child)
    home_messages.apply_calibration(frames, Calibration(links=[message]))
    pose = conversions.transform_to_pose(fleet.T_odom_home)
    home_messages.apply_home(frames, Home(reference="uav1", home_in_odom=pose))
    direct = HomeFrames()
    direct.calibrate([link])
    direct.set_home("uav1", fleet.T_odom_home)
    for name in ("uav1", "uav2"):
        assert np.allclose(frames.T_home_odom[name], direct.T_home_odom[name], atol=ROUNDING)
        assert np.allclose(
            frames.places[name].covariance, direct.places[name].covariance, atol=1e-12
        )

    before = frames.T_home_odom
    message.child_odom_in_parent_odom.orientation.w = float("nan")
    with pytest.raises(GeometryError):
        home_messages.apply_calibration(frames, Calibration(links=[message]))
    pose.position.x = float("nan")
    with pytest.raises(GeometryError):
        home_messages.apply_home(frames, Home(reference="uav1", home_in_odom=pose))
    assert all((frames.T_home_odom[n] == before[n]).all() for n in before)
