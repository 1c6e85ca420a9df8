# SPDX-License-Identifier: Apache-2.0
"""Sessions: small real bags, whole and broken."""

import json
import subprocess

import numpy as np
import pytest
import rosbag
import rospy
from std_msgs.msg import String
from support.scenes import true_depth
from support.sessions import T0, T_HOME_CAM, T_O1_O2, write_control, write_session

from fcsv_geometry import transforms
from fcsv_geometry.ros import conversions
from fcsv_geometry.version import VERSION
from fcsv_msgs.msg import Calibration, CalibrationLink
from fcsv_stereo import pipeline
from fcsv_stereo.cli import main
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.errors import InputError
from fcsv_stereo.map_files.output import read_ply
from fcsv_stereo.sessions.files import bags_of
from fcsv_stereo.sessions.read import read_session
from fcsv_stereo.thesis import ThesisOptions

OPTIONS = ThesisOptions(threshold=ErrorThreshold(5.0, False))


def test_a_session_becomes_a_map(tmp_path):
    session = write_session(tmp_path / "session")
    out = tmp_path / "map"
    document = pipeline.run(pipeline.MapRequest(session, out, "thesis", OPTIONS))
    depth = np.load(out / "depth.npy")
    truth = true_depth(T_HOME_CAM["uav1"])
    known = np.isfinite(depth)
    assert known.mean() > 0.5 and np.median(np.abs(depth - truth)[known] / truth[known]) < 0.08
    assert np.allclose(document["reference"]["T_home_cam"], T_HOME_CAM["uav1"], atol=1e-6)
    cloud = read_ply(out / "map.ply")
    assert len(cloud) == document["points"] and cloud.points_home_m[:, 0].max() < 30.0
    assert (out / "report.html").stat().st_size > 10000
    assert f"Made by fcsv {VERSION}." in (out / "report.html").read_text()
    assert json.loads((out / "report.json").read_text())["fcsv_version"] == VERSION
    pipeline.run(pipeline.MapRequest(session, out, "thesis", OPTIONS))  # an earlier map is replaced


def test_who_waits_for_a_map_sees_it_come_on_step_by_step(tmp_path):
    steps = []
    request = pipeline.MapRequest(write_session(tmp_path / "session"), tmp_path / "map")
    document = pipeline.run(request, lambda step, share: steps.append((step, share)))
    shares = [share for _, share in steps]
    words = [step for step, _ in steps]
    assert shares == sorted(shares) and shares[0] == 0.0 and shares[-1] < 1.0
    assert np.max(np.diff([*shares, 1.0])) < 0.35, "stands for long at one percentage"
    assert len(set(words)) == len(words) >= 7 and words[-1] == "drawing the report"
    seconds = dict(document["timing_s"])
    total_s = seconds.pop("total")
    assert "report" in seconds and sum(seconds.values()) <= total_s + 1e-3


def half_truth(folder, files):
    """truth/ as an interrupted simulation leaves it."""
    (folder / "truth").mkdir()
    for name, text in files.items():
        (folder / "truth" / name).write_text(text)


_HEAD = "stamp_s,vehicle,x,y,z,qx,qy,qz,qw\n"


@pytest.mark.parametrize(
    "files, words",
    [
        ({"scene.ply": "ply"}, "cameras.csv"),
        ({"cameras.csv": _HEAD}, "scene.ply: does not exist"),
        ({"scene.ply": "ply", "cameras.csv": _HEAD + "1.0,uav1,0"}, "line 2"),
    ],
)
def test_half_a_truth_is_a_warning_and_the_map_is_made(files, words, tmp_path):
    session = write_session(tmp_path / "session")
    half_truth(session, files)
    document = pipeline.run(pipeline.MapRequest(session, tmp_path / "map", "thesis", OPTIONS))
    told = [w for w in document["warnings"] if w.startswith("not compared with truth: ")]
    assert len(told) == 1 and words in told[0] and "truth" not in document
    assert np.isfinite(np.load(tmp_path / "map" / "depth.npy")).mean() > 0.5


def test_where_no_map_can_be_written_is_said_before_anything_is_read(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(pipeline, "load", lambda *_: pytest.fail("read the input first"))
    (tmp_path / "file").write_text("a file")
    (tmp_path / "in").mkdir()
    assert main([str(tmp_path / "in"), "-o", str(tmp_path / "file" / "map")]) == 2
    assert "file: a file stands there" in capsys.readouterr().err


def test_a_disk_that_takes_no_more_is_one_line_and_leaves_nothing(tmp_path):
    """A limit on the size of files stands for the full disk: writing fails in the same places."""
    session, out = write_session(tmp_path / "session"), tmp_path / "map"
    command = (
        f"ulimit -f 8; exec rosrun fcsv_stereo map {session} -o {out} --method thesis --error 5"
    )
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.strip().splitlines()[-1].startswith("map: "), (
        done.stderr
    )
    assert (
        "Traceback" not in done.stderr
        and not out.exists()
        and list(tmp_path.iterdir()) == [session]
    )


def test_a_session_carries_the_covariance_of_each_picture(tmp_path):
    covariance = np.diag([0.01**2] * 3 + [0.003**2] * 3)
    given = read_session(write_session(tmp_path / "session", covariance=covariance))
    (c,) = given.configurations
    assert given.warnings == []
    for p in (*c.references, *c.others):
        nearest = round((p.stamp_s - T0 + 0.5) * 15.0)
        assert np.allclose(p.covariance, covariance * (1 + nearest))


NOT_POSITIVE = np.diag([1e-4] * 5 + [-1e-6])


def test_pictures_keep_the_calibration_by_which_they_were_flown(tmp_path):
    windows = [(T0, T0 + 0.45), (T0 + 0.55, T0 + 1.0)]
    folder = write_session(tmp_path / "flown", windows=windows)
    T_moved = transforms.from_xyz_yaw([0.2, 0.0, 0.0], 0.0) @ T_O1_O2
    with rosbag.Bag(str(folder / "control.bag"), "a") as bag:
        link = CalibrationLink(parent="uav1", child="uav2")
        link.child_odom_in_parent_odom = conversions.transform_to_pose(T_moved)
        stamp_s = T0 + 0.5
        calibration = Calibration(conversions.header(stamp_s, "uav1/odom"), [link])
        bag.write("/calibration", calibration, rospy.Time.from_sec(stamp_s))
    first, second = read_session(folder).configurations
    places = [c.others[0].T_home_cam[:3, 3] for c in (first, second)]
    assert np.allclose(places[0], T_HOME_CAM["uav2"][:3, 3])
    assert np.linalg.norm(places[1] - places[0]) == pytest.approx(0.2, abs=1e-6)
    assert all(np.allclose(p.T_home_cam, T_HOME_CAM["uav1"]) for p in second.references)


@pytest.mark.parametrize(
    "covariance, drop, vehicles, why",
    [
        (None, (), "uav1, uav2", "no camera_pose near"),  # a session of before
        (1e-4 * np.eye(6), ("/uav2/camera_pose",), "uav2", "no camera_pose near"),
        (np.full((6, 6), np.nan), (), "uav1, uav2", "NaN"),
        (np.zeros((6, 6)), (), "uav1, uav2", "not positive definite"),
        (NOT_POSITIVE, (), "uav1, uav2", "not positive definite"),
    ],
)
def test_without_a_covariance_a_session_says_which_prior_serves(
    tmp_path, covariance, drop, vehicles, why
):
    given = read_session(write_session(tmp_path / "session", covariance=covariance, drop=drop))
    (line,) = given.warnings
    assert (
        f"poses of {vehicles} are known is not recorded" in line and why in line and "15 cm" in line
    )
    (c,) = given.configurations
    without = {p.vehicle for p in (*c.references, *c.others) if p.covariance is None}
    assert without == set(vehicles.split(", ")) and given.prior.position_m == 0.15


def test_one_bag_that_holds_everything_is_a_session(tmp_path):
    session = write_session(tmp_path / "session")
    merged = tmp_path / "all.bag"
    with rosbag.Bag(str(merged), "w") as target:
        for name in ("uav1", "uav2", "control"):
            with rosbag.Bag(str(session / f"{name}.bag")) as source:
                for topic, message, t in source.read_messages():
                    target.write(topic, message, t)
    given = read_session(merged)
    assert len(given.configurations[0].references) == 4 and given.truth_folder is None


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"drop": ("capture",)}, ["/mission/capture", "no configuration was recorded"]),
        ({"drop": ("/calibration",)}, ["/calibration", "never calibrated"]),
        ({"drop": ("/home",)}, ["/home", "never set"]),
        ({"drop": ("camera_info",)}, ["camera_info", "missing"]),
        ({"drop": ("odometry/body",)}, ["odometry/body", "missing"]),
        ({"drop": ("/tf_static",)}, ["/tf_static", "base_link"]),
        ({"drop": ("image_raw",)}, ["no configuration has pictures"]),
        ({"encoding": "yuv422"}, ["image_raw", "yuv422", "rgb8"]),
        ({"window": (T0 + 50, T0 + 51)}, ["overlap in time"]),
        ({"stamp_offset_s": 0.6, "drop": ("odometry/body",)}, ["odometry/body"]),
    ],
)
def test_bad_sessions_are_named_in_one_line(tmp_path, changes, words):
    session = write_session(tmp_path / "session", **changes)
    with pytest.raises(InputError) as error:
        pipeline.run(pipeline.MapRequest(session, tmp_path / "map", "thesis", OPTIONS))
    assert "\n" not in str(error.value) and all(w in str(error.value) for w in words), str(
        error.value
    )
    assert [p.name for p in tmp_path.iterdir()] == ["session"]


@pytest.mark.parametrize("topic", ["/home", "/uav2/odometry/body", "/uav1/camera/color/image_raw"])
def test_another_message_under_a_name_that_is_read_is_named(tmp_path, topic):
    session = write_session(tmp_path / "session", drop=(topic,))
    with rosbag.Bag(str(session / "control.bag"), "a") as bag:
        bag.write(topic, String("elsewhere"), rospy.Time.from_sec(T0))
    with pytest.raises(
        InputError, match=rf"control\.bag, topic {topic}: is of type std_msgs/String, not \w+/\w+"
    ):
        read_session(session)


class Odd(String):
    __slots__ = String.__slots__
    _full_text = "this is no definition"


def test_topics_that_are_not_read_may_hold_anything(tmp_path):
    session = write_session(tmp_path / "session")
    with rosbag.Bag(str(session / "control.bag"), "a") as bag:
        bag.write("/notes", Odd("..."), rospy.Time.from_sec(T0))
    assert len(read_session(session).configurations[0].others) == 4


def test_an_empty_bag_lacks_its_topics(tmp_path):
    session = write_session(tmp_path / "session")
    with rosbag.Bag(str(session / "uav2.bag"), "w"):
        pass
    with pytest.raises(InputError, match=r"/uav2/odometry/body is missing"):
        read_session(session)


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_compressed_bags_are_read(tmp_path, compression):
    session = write_session(tmp_path / "session")
    whole = read_session(session).configurations[0].others
    with rosbag.Bag(str(session / "uav2.bag")) as bag:
        messages = list(bag.read_messages())
    with rosbag.Bag(str(session / "uav2.bag"), "w", compression=compression) as bag:
        for topic, message, t in messages:
            bag.write(topic, message, t)
    found = read_session(session).configurations[0].others
    assert len(found) == 4 and all(np.array_equal(a.image, b.image) for a, b in zip(found, whole))


def cut(path, share):
    """The file without its end."""
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])


def test_a_cut_bag_is_repaired_and_maps_with_what_it_holds(tmp_path):
    session = write_session(tmp_path / "session")
    whole = read_session(session)
    path = session / "uav2.bag"
    cut(path, 0.8)
    original = path.read_bytes()
    given = read_session(session)
    assert any("uav2.bag was not closed or is damaged: repaired, " in w for w in given.warnings), (
        given.warnings
    )
    assert 1 <= len(given.configurations[0].others) < len(whole.configurations[0].others) == 4
    assert len(given.configurations[0].references) == 4
    assert (session / "uav2.bag.broken").read_bytes() == original
    again = read_session(session)
    assert again.warnings == whole.warnings
    assert len(again.configurations[0].others) == len(given.configurations[0].others)


def test_an_unclosed_bag_is_a_bag(tmp_path):
    session = write_session(tmp_path / "session")
    (session / "uav2.bag").rename(session / "uav2.bag.active")
    assert (
        len(read_session(session).configurations[0].others) == 4 and (session / "uav2.bag").exists()
    )


def test_what_is_missing_is_named(tmp_path):
    session = write_session(tmp_path / "session")
    (session / "uav2.bag").unlink()
    with pytest.raises(
        InputError, match=r"/uav2/odometry/body is missing.*uav2\.bag is missing: copy it"
    ):
        read_session(session)
    (session / "control.bag").unlink()
    with pytest.raises(
        InputError, match=r"/mission/capture is missing.*control\.bag is missing: copy it"
    ):
        read_session(session)


_WINDOWS = [(T0, T0 + 0.5), (T0 + 0.5, T0 + 1.0)]
_LOST = "control.bag is missing or lacks "


def test_without_the_control_pcs_bag_what_the_vehicles_heard_makes_the_map(tmp_path):
    heard = {"uav1": _WINDOWS[:1], "uav2": _WINDOWS}  # the radio to uav1 was cut
    session = write_session(tmp_path / "session", windows=_WINDOWS, heard=heard)
    whole = read_session(session)
    assert not any(_LOST in w for w in whole.warnings)
    (session / "control.bag").unlink()
    given = read_session(session)
    assert (
        [len(c.others) for c in given.configurations]
        == [len(c.others) for c in whole.configurations]
        == [2, 2]
    )
    for a, b in zip(given.configurations, whole.configurations):
        assert np.array_equal(a.others[0].T_home_cam, b.others[0].T_home_cam)
    (lost,) = [w for w in given.warnings if _LOST in w]
    assert (
        "/calibration, /home, /mission/capture of 2 configurations: taken from what the vehicles heard"
        in lost
    )
    assert any("control.bag is missing: copy it" in w for w in given.warnings)


def test_windows_that_the_control_pcs_bag_lost_come_from_the_vehicles_but_none_of_a_flight_before(
    tmp_path,
):
    session = write_session(tmp_path / "session", windows=_WINDOWS[:1], heard={"uav1": _WINDOWS})
    given = read_session(session)
    assert len(given.configurations) == 2
    assert [w for w in given.warnings if f"{_LOST}/mission/capture of 1 configuration:" in w]
    split(session, "uav1", T0 + 1.5, 1)  # home is set anew
    with rosbag.Bag(str(session / "uav1.1.bag"), "a") as bag:
        write_control(bag, ("/calibration", "capture"), [], stamp_s=T0 + 1.6)
    assert len(read_session(session).configurations) == 1


def split(session, name, at_s, number):
    """What the bag holds from ``at_s`` on goes into a part of its own."""
    with rosbag.Bag(str(session / f"{name}.bag")) as bag:
        messages = list(bag.read_messages())
    for path, first in ((session / f"{name}.bag", True), (session / f"{name}.{number}.bag", False)):
        with rosbag.Bag(str(path), "w") as bag:
            for topic, message, t in messages:
                if (t.to_sec() < at_s) == first:
                    bag.write(topic, message, t)


def test_parts_are_one_recording_and_a_missing_or_foreign_one_is_named(tmp_path):
    session = write_session(tmp_path / "session")
    whole = read_session(session)
    split(session, "uav2", T0 + 0.5, 1)
    assert len(read_session(session).configurations[0].others) == 4, (
        "parts beside the first need no line in the file"
    )
    description = session / "session.yaml"
    description.write_text(description.read_text() + "parts: {uav2: [uav2.1.bag]}\n")
    given = read_session(session)
    assert len(given.configurations[0].others) == 4 and given.warnings == whole.warnings
    part = session / "uav2.1.bag"
    part.write_bytes(b"#ROSBAG V1.2\n" + b"x" * 500)
    given = read_session(session)
    assert len(given.configurations[0].others) == 2
    (warning,) = [w for w in given.warnings if "uav2.1.bag" in w]
    assert "is a bag of version 1.2, only 2.0 is read" in warning and "left out" in warning
    part.unlink()
    given = read_session(session)
    assert len(given.configurations[0].others) == 2
    assert [w for w in given.warnings if "uav2.1.bag is missing: copy it" in w]


def test_pictures_without_odometry_are_left_out_and_said(tmp_path):
    session = write_session(tmp_path / "session", stamp_offset_s=2.0, window=(T0 + 1.5, T0 + 3.0))
    given = read_session(session)
    assert any("no odometry at their stamp" in w for w in given.warnings)
    assert len(given.configurations[0].references) < 4


@pytest.mark.parametrize("odometry_s, left", [(0.12, 4), (0.3, 4), (0.41, 0)])
def test_poses_of_a_tracker_on_the_ground_are_rare_and_serve(tmp_path, odometry_s, left):
    """It gives 8 to 10 a second, and some are lost; over 0.4 s nothing is made up."""
    session = write_session(tmp_path / "session", odometry_s=odometry_s)
    if not left:
        with pytest.raises(InputError, match="no odometry at their stamp"):
            read_session(session)
        return
    assert len(read_session(session).configurations[0].references) == left


def test_neither_session_nor_photographs(tmp_path):
    with pytest.raises(InputError, match="neither a session"):
        pipeline.load(tmp_path)
    with pytest.raises(InputError, match="does not exist"):
        pipeline.load(tmp_path / "nowhere")


@pytest.mark.parametrize(
    "text, words",
    [
        (b"version: [\n", "session.yaml, line 2: not valid YAML"),
        (b"\xe9: 1\n", "session.yaml: not valid YAML"),
        (b"version: 1\n", "session.yaml: 'bags' must name a bag for every machine"),
        (b"bags: [uav1.bag]\n", "session.yaml: 'bags' must name a bag for every machine"),
        (b"just words\n", "session.yaml: 'bags' must name a bag for every machine"),
    ],
)
def test_a_session_description_that_is_none_is_one_line(text, words, tmp_path):
    (tmp_path / "session.yaml").write_bytes(text)
    with pytest.raises(InputError) as refused:
        bags_of(tmp_path, [])
    assert words in str(refused.value) and "\n" not in str(refused.value)
