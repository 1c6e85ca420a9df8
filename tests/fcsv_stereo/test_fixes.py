# SPDX-License-Identifier: Apache-2.0
"""GPS fixes of a session: read, joined, and written with the map, where a survey reads them."""

import json
import math

import numpy as np
import pytest
import rosbag
from sensor_msgs.msg import NavSatFix
from support.sessions import T0, T_HOME_CAM, write_session

from fcsv_geometry import transforms
from fcsv_geometry.errors import GeometryError, PoseUnavailable
from fcsv_geometry.home import HomeFrames
from fcsv_geometry.ros import conversions
from fcsv_stereo import pipeline
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.errors import InputError
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.sessions.fixes import FIXES, fix_of, session_gps
from fcsv_stereo.sessions.read import read_session
from fcsv_stereo.survey.views.station import Prior
from fcsv_stereo.survey.views.view import read_view
from fcsv_stereo.thesis import ThesisOptions

OPTIONS = ThesisOptions(threshold=ErrorThreshold(5.0, False))
PLACE = (48.1, 11.6, 560.0)


def in_home():
    frames = HomeFrames(alone=True)
    frames.set_home("uav1", np.eye(4))
    return frames


def fix(stamp_s=T0, place=PLACE, status=0, sigma_m=2.0, known=2):
    message = NavSatFix(header=conversions.header(stamp_s, "uav1/base_link"))
    message.status.status = status
    message.latitude, message.longitude, message.altitude = place
    message.position_covariance_type = known
    message.position_covariance = [sigma_m**2, 0, 0, 0, sigma_m**2, 0, 0, 0, 16.0]
    return message


def add_fixes(session, by_vehicle):
    for vehicle, messages in by_vehicle.items():
        with rosbag.Bag(str(session / f"{vehicle}.bag"), "a") as bag:
            for message in messages:
                bag.write(f"/{vehicle}/{FIXES}", message, message.header.stamp)
    return session


class Still:
    """A vehicle that stands still until 100 s."""

    def __init__(self, p_m=(1.0, 2.0, 3.0)):
        self.T = transforms.from_xyz_yaw(list(p_m), 0.0)

    def at(self, stamp_s):
        if stamp_s > 100.0:
            raise PoseUnavailable("later")
        return self.T


def joined(told, tracks=None):
    return session_gps({"uav1": told}, tracks or {"uav1": Still()}, in_home())


def told(count=5, sigma_m=2.0, step_deg=0.0, start_s=0.0):
    return [
        (start_s + i, Gps(48.1 + i * step_deg, 11.6, 560.0, sigma_m, 4.0)) for i in range(count)
    ]


def test_fixes_of_one_flight_err_alike_so_that_their_middle_is_no_surer_than_one():
    found = joined(told(100))
    assert found.fix.sigma_m == 2.0 and found.fixes == {"uav1": 100}
    assert np.allclose(found.place_home_m, [1.0, 2.0, 3.0])


def test_a_fix_that_jumps_away_and_those_before_or_after_the_poses_do_not_count():
    jumped = (2.5, Gps(48.1 + 0.01, 11.6, 560.0, 2.0, 4.0))  # by a kilometre
    found = joined([*told(), jumped, *told(start_s=200.0)])
    assert found.fixes == {"uav1": 5} and found.fix.latitude_deg == pytest.approx(48.1, abs=1e-9)
    assert joined(told(start_s=200.0)) is None and joined([]) is None
    assert session_gps({"uav1": told()}, {}, in_home()) is None


@pytest.mark.parametrize(
    "message, expected",
    [
        (fix(), Gps(*PLACE, 2.0, 4.0)),
        (fix(status=-1), None),
        (fix(known=0), Gps(*PLACE, 2.0, 4.0)),
        (fix(sigma_m=float("nan")), Gps(*PLACE, 2.0, 4.0)),
        (fix(sigma_m=0.02, status=2), Gps(*PLACE, 0.02, 4.0)),
    ],
)
def test_what_a_message_says(message, expected):
    assert fix_of(message) == expected


@pytest.mark.parametrize(
    "place", [(float("nan"), 11.6, 0.0), (91.0, 11.6, 0.0), (48.0, 200.0, 0.0)]
)
def test_a_place_that_is_none_is_left_out_and_said(place, tmp_path):
    with pytest.raises(GeometryError, match="no place on the earth"):
        fix_of(fix(place=place))
    session = add_fixes(
        write_session(tmp_path / "s"), {"uav1": [fix(), fix(T0 + 0.5), fix(T0 + 1.0, place)]}
    )
    given = read_session(session)
    assert given.gps.fixes == {"uav1": 2}
    assert any("no place on the earth" in w for w in given.warnings)


def test_another_type_under_the_name_is_refused(tmp_path):
    session = write_session(tmp_path / "s")
    with rosbag.Bag(str(session / "uav1.bag"), "a") as bag:
        bag.write(f"/uav1/{FIXES}", conversions.header(T0, ""), t=None)
    with pytest.raises(InputError, match="is of type"):
        read_session(session)


def test_a_map_says_where_its_vehicles_were_and_a_view_reads_it(tmp_path):
    by_vehicle = {
        v: [fix(T0 + 0.2 * i, (PLACE[0], PLACE[1], math.nan)) for i in range(5)] for v in T_HOME_CAM
    }
    session = add_fixes(write_session(tmp_path / "s"), by_vehicle)
    document = pipeline.run(pipeline.MapRequest(session, tmp_path / "map", "thesis", OPTIONS))
    written = json.loads((tmp_path / "map" / "report.json").read_text())["gps"]
    assert written == document["gps"] and written["height_m"] is None
    assert written["fixes"] == dict.fromkeys(T_HOME_CAM, 5)
    view = read_view(tmp_path / "map", "s", "s", lambda T, _n: Prior(T, *[np.inf] * 4))
    assert view.gps.latitude_deg == PLACE[0] and view.gps.height_sigma_m >= 1e3
    place = transforms.apply(view.T_home_cam, view.gps_cam_m[None])[0]
    assert np.allclose(place, written["place_home_m"])
