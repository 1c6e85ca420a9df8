# SPDX-License-Identifier: Apache-2.0
"""Bags of other robots become photographs that map reads: poses of every source, clocks, choice,
what is refused."""

import cv2
import numpy as np
import pytest
from support import foreign_bags as fb
from support.ros2_bags import to_ros2
from support.scenes import CAMERA, camera_pose, photograph, true_depth

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo import cli
from fcsv_stereo.bag_import import CameraRequest, ImportRequest, import_bag
from fcsv_stereo.bag_import.choice import PosedStamp, choose
from fcsv_stereo.bag_import.command import main
from fcsv_stereo.errors import InputError, OutputError
from fcsv_stereo.photos.models import read_model
from fcsv_stereo.posed import colmap
from fcsv_stereo.sessions import read_session

KINDS = ("ros1", "sqlite3", "mcap", "plain mcap")
MOUNT = "0.3,0.1,0.2,0,{:.9f},{:.9f}".format(*np.degrees([0.2, 0.1]))
IDENTITY = np.eye(4)


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """One walk as a bag of each kind, and its poses as a file."""
    folder = tmp_path_factory.mktemp("walk")
    ros1 = fb.write(folder / "walk.bag", fb.messages())
    found = {"ros1": ros1, **{k: to_ros2([ros1], folder / k, k) for k in ("sqlite3", "mcap")}}
    (found["plain mcap"],) = found["mcap"].glob("*.mcap")
    return {**found, "tum": fb.write_tum(folder / "walk.tum")}


def asked(pose="/odom", mount=None, topic="/cam/image_raw", **more):
    camera = {k: more.pop(k) for k in ("axes", "info", "offset_s") if k in more}
    return ImportRequest(
        (CameraRequest(topic, str(pose), mount, **camera),), more.pop("range_m", 20.0), **more
    )


def truth(done, T_world_odom=IDENTITY, shift_s=0.0):
    """Largest errors (m, rad) of the imported poses."""
    found = []
    for d in done.pictures:
        T = T_world_odom @ fb.T_odom_base(d.posed.own_stamp_s + shift_s) @ fb.T_BASE_OPTICAL
        away_m = np.linalg.norm(T[:3, 3] - d.posed.T_world_cam[:3, 3])
        found.append((away_m, transforms.rotation_angle(T, d.posed.T_world_cam)))
    return np.max(found, axis=0)


SOURCES = {
    "odometry": ({"pose": "/odom"}, IDENTITY),
    "pose": ({"pose": "/pose", "mount": MOUNT}, IDENTITY),
    "pose of a frame": ({"pose": "/pose", "mount": "base_link"}, IDENTITY),
    "covariance": ({"pose": "/pose_cov", "mount": MOUNT}, IDENTITY),
    "transform": ({"pose": "/vicon"}, IDENTITY),
    "tf": ({"pose": "camera_optical_frame"}, fb.T_MAP_ODOM),
    "tf of the body": ({"pose": "base_link", "world": "odom"}, IDENTITY),
    "odometry in map": ({"pose": "/odom", "world": "map"}, fb.T_MAP_ODOM),
    "compressed": ({"pose": "/odom", "topic": "/jpg/image_raw"}, IDENTITY),
    "tum": ({"pose": "tum", "mount": MOUNT}, IDENTITY),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("source", SOURCES)
def test_poses_are_those_of_the_camera(bags, tmp_path, kind, source):
    """Positions and turns are linear in time between poses: rounding alone is left (TUM: nine
    digits)."""
    options, T_world_odom = SOURCES[source]
    options = {**options, "pose": bags["tum"] if options["pose"] == "tum" else options["pose"]}
    done = import_bag([bags[kind]], tmp_path / "out", asked(**options))
    assert (truth(done, T_world_odom) < 1e-6).all() and 4 <= len(done.pictures) <= 8
    cameras, posed = read_model(tmp_path / "out")
    by_name = {d.name: d for d in done.pictures}
    for p in posed:
        np.testing.assert_allclose(p.T_home_cam, by_name[p.name].posed.T_world_cam, atol=1e-9)
        pixel = cv2.imread(str(tmp_path / "out" / "images" / p.name))[0, 0]
        assert list(pixel) == [round(10 * (by_name[p.name].posed.own_stamp_s - fb.START_S))] * 3
    (camera,) = cameras.values()
    np.testing.assert_allclose((camera.fx, camera.cx), (fb.SMALL.fx, fb.SMALL.cx))
    given = colmap.read_photographs(tmp_path / "out")
    assert given.configurations[0].references[0].name == done.pictures[0].name
    assert done.has_priors == (
        source not in ("pose", "pose of a frame", "transform", "tf", "tf of the body", "tum")
    )


def test_covariances_are_carried_to_the_camera(bags, tmp_path):
    done = import_bag([bags["ros1"]], tmp_path / "out", asked())
    for p in colmap.read_photographs(tmp_path / "out").configurations[0].others:
        stamp_s = next(d.posed.stamp_s for d in done.pictures if d.name == p.name)
        x, y, z = (fb.T_odom_base(stamp_s) @ fb.T_BASE_OPTICAL)[:3, 3] - fb.T_odom_base(stamp_s)[
            :3, 3
        ]
        # a turn by (p, q, r) moves the camera by (qz - ry, rx - pz, py - qx)
        a, b, c = 0.002**2, 0.003**2, 0.004**2
        expected = [
            0.02**2 + b * z * z + c * y * y,
            0.03**2 + c * x * x + a * z * z,
            0.04**2 + a * y * y + b * x * x,
        ]
        np.testing.assert_allclose(np.diag(p.covariance), [*expected, a, b, c], rtol=1e-4)


def test_the_choice_fills_steps_of_the_baseline(bags, tmp_path):
    done = import_bag([bags["ros1"]], tmp_path / "out", asked(most=6))
    reference, *others = [d.posed.T_world_cam[:3, 3] for d in done.pictures]
    baselines = [np.linalg.norm(p - reference) for p in others]
    assert len(baselines) <= 5 and baselines == sorted(baselines)
    assert baselines[0] < 0.5 and baselines[-1] > 1.2 and baselines[-1] <= 2.0


def stamps_at(places, camera=0, look=(0.0, 0.0, 0.0), stamp_s=10.0):
    return [
        PosedStamp(camera, stamp_s + i, stamp_s + i, CAMERA, camera_pose(p, look))
        for i, p in enumerate(places)
    ]


def test_two_cameras_that_stand_give_one_pair_at_one_instant():
    left, right = [[0.0, 0.0, 0.0]] * 50, [[0.0, -0.8, 0.0]] * 50
    found = choose([*stamps_at(left), *stamps_at(right, 1, stamp_s=10.02)], 20.0, 8)
    assert [p.camera for p in found] == [0, 1] and abs(found[0].stamp_s - found[1].stamp_s) < 0.05


def test_the_nearest_in_time_is_taken():
    """The other camera stands: of its fifty pictures, that of the reference's instant."""
    posed = [
        *stamps_at([[0.0, 0.0, 0.0]] * 50),
        *stamps_at([[0.0, -0.8, 0.0]] * 50, 1, stamp_s=10.02),
    ]
    found = choose(posed, 20.0, 8, reference_s=40.0)
    assert [round(p.stamp_s, 2) for p in found] == [40.0, 40.02]


def test_both_axes_are_chosen_and_the_wanted_reference():
    places = [
        [0, 0, 0],
        *([0, y, 0] for y in (0.3, 0.6, 1.2)),
        *([0, 0, z] for z in (0.3, 0.6, 1.2)),
    ]
    found = choose(stamps_at(places), 20.0, 7, reference_s=10.2)
    assert found[0].stamp_s == 10.0
    away = [p.T_world_cam[:3, 3] for p in found[1:]]
    assert sum(a[1] > 0 for a in away) >= 2 and sum(a[2] > 0 for a in away) >= 2


def test_a_long_walk_is_chosen_from_near_pictures():
    """Half an hour at 10 Hz and 1 m/s: what serves a scene at 20 m lies within two seconds."""
    found = choose(stamps_at([[0.0, 0.1 * i, 0.0] for i in range(18000)]), 20.0, 8)
    away = [np.linalg.norm(p.T_world_cam[:3, 3] - found[0].T_world_cam[:3, 3]) for p in found[1:]]
    assert len(found) >= 6 and away == sorted(away) and max(away) <= 2.0


@pytest.mark.parametrize(
    "places, look, words",
    [
        ([[0, 0, 0], [1, 0, 0]], (0, 0, 0), "move forward"),
        ([[0, 0, 0], [0, 0.01, 0]], (0, 0, 0), "at most 0.01 m; does --range-m fit?"),
    ],
    ids=["forward", "short"],
)
def test_no_pair_is_named(places, look, words):
    with pytest.raises(InputError, match=words.replace("?", r"\?")):
        choose(stamps_at(places, look=look), 20.0, 8)


# ---- clocks ----


def entries(change=lambda topic, message, stamp_s: [(topic, message, stamp_s)]):
    return [e for given in fb.messages() for e in change(*given)]


def shifted(by_s):
    def change(topic, message, stamp_s):
        if topic.startswith("/cam"):
            message.header.stamp = type(message.header.stamp).from_sec(stamp_s + by_s)
        return [(topic, message, stamp_s)]

    return entries(change)


@pytest.mark.parametrize("by_s", [0.5, 300.0])
def test_a_clock_of_its_own_is_named_and_can_be_corrected(tmp_path, by_s):
    bag = fb.write(tmp_path / "a.bag", shifted(-by_s))
    if by_s > 2.0:
        with pytest.raises(
            InputError,
            match=r"no picture has a pose.*two clocks 300.000 s apart: --offset-s 300.000",
        ):
            import_bag([bag], tmp_path / "out", asked())
    else:
        done = import_bag([bag], tmp_path / "out", asked())
        assert any("two clocks? --offset-s" in w for w in done.warnings)
    done = import_bag([bag], tmp_path / "offset", asked(offset_s=by_s))
    assert (truth(done, shift_s=by_s) < 1e-6).all()
    done = import_bag([bag], tmp_path / "receipt", asked(by_receipt=True))
    # both were recorded 10 ms after their stamps
    assert (truth(done, shift_s=-0.01) < 1e-6).all()


def test_pictures_without_a_stamp_need_the_time_of_recording(tmp_path):
    def change(topic, message, stamp_s):
        if topic == "/cam/image_raw":
            message.header.stamp = type(message.header.stamp)()
        return [(topic, message, stamp_s)]

    bag = fb.write(tmp_path / "a.bag", entries(change))
    with pytest.raises(
        InputError, match=r"/cam/image_raw: none of its 21 messages.*stamps are 0.*--by-receipt"
    ):
        import_bag([bag], tmp_path / "out", asked())
    assert len(import_bag([bag], tmp_path / "out", asked(by_receipt=True)).pictures) >= 4


def test_silence_of_poses_is_not_bridged_unless_asked(bags, tmp_path):
    stamps = [s for s in fb.pose_stamps() if not 1000.45 < s < 1001.55]
    file = fb.write_tum(tmp_path / "gap.tum", stamps=stamps)
    done = import_bag([bags["ros1"]], tmp_path / "out", asked(file, MOUNT))
    assert not [d for d in done.pictures if 1000.45 < d.posed.stamp_s < 1001.55]
    assert any(
        "11 of 21 pictures of /cam/image_raw have no pose" in w and "silent for 1.1" in w
        for w in done.warnings
    )
    done = import_bag([bags["ros1"]], tmp_path / "bridged", asked(file, MOUNT, gap_s=1.2))
    assert not any("have no pose" in w for w in done.warnings) and (truth(done) < 1e-6).all()


# ---- what is refused ----


def test_two_worlds_that_nothing_connects_are_refused(bags, tmp_path):
    def other(message):
        message.header.frame_id = "robot2/odom"

    bag = fb.write(tmp_path / "a.bag", spoilt("/pose_cov", other))
    cameras = (
        CameraRequest("/cam/image_raw", "/odom"),
        CameraRequest("/jpg/image_raw", "/pose_cov", "base_link"),
    )
    with pytest.raises(
        InputError, match="/pose_cov is in frame 'robot2/odom', other poses or --world in 'odom'"
    ):
        import_bag([bag], tmp_path / "out", ImportRequest(cameras, 20.0))
    done = import_bag([bags["mcap"]], tmp_path / "out", ImportRequest(cameras, 20.0))
    assert (truth(done) < 1e-6).all() and len(done.lags_s) == 4


def without(*names):
    return entries(
        lambda topic, message, stamp_s: [] if topic in names else [(topic, message, stamp_s)]
    )


def spoilt(topic, change):
    def changed(name, message, stamp_s):
        if name == topic:
            change(message)
        return [(name, message, stamp_s)]

    return entries(changed)


def nan(message):
    message.pose.pose.position.x = float("nan")


def no_frame(message):
    message.child_frame_id = ""


def other_frame(message):
    message.header.frame_id = "camera"


@pytest.mark.parametrize(
    "options, words",
    [
        (
            {"topic": "/kam"},
            r"/kam: is not in the bag; topics of pictures there: /cam/image_raw \(sensor_msgs/Image\), ",
        ),
        ({"topic": "/odom"}, r"--camera /odom: is of type nav_msgs/Odometry"),
        (
            {"info": "/odom"},
            r"no camera_info: /odom is of type nav_msgs/Odometry; name it by --info, there are: /cam/cam",
        ),
        (
            {"pose": "/odometry"},
            r"/odometry: is no topic of the bag and no file; topics of poses there: /odom \(nav_msgs",
        ),
        ({"pose": "/cam/camera_info"}, r"is of type sensor_msgs/CameraInfo"),
        (
            {"pose": "drone"},
            r"frame 'drone' is not in the bag's tf; frames there: base_link, camera_link, camera_opt",
        ),
        ({"pose": "map"}, "is the root of tf"),
        ({"world": "earth"}, "frame 'earth' is not in the bag's tf"),
        ({"pose": "/pose"}, r"/pose does not say what it is the pose of: give --mount optical"),
        ({"mount": "drone"}, "frame 'drone' is not in the bag's tf"),
        ({"mount": "1,2,3"}, "six numbers are meant"),
        ({"range_m": 2000.0}, "none are 20 to 200 m apart"),
    ],
    ids=lambda v: "-".join(f"{k}={w}" for k, w in v.items()) if isinstance(v, dict) else "",
)
def test_what_is_not_there_is_named_with_what_is(bags, tmp_path, options, words):
    with pytest.raises(InputError, match=words):
        import_bag([bags["mcap"]], tmp_path / "out", asked(**options))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "given, words",
    [
        (without("/cam/camera_info"), "/cam/camera_info is not in the bag; name it by --info"),
        (without("/tf_static"), "and 'base_link' is not in tf|'camera_optical_frame' is not in tf"),
        (spoilt("/odom", nan), r"--pose /odom: .*pose is not finite"),
        (spoilt("/odom", no_frame), "/odom does not say what it is the pose of"),
        (
            spoilt("/cam/image_raw", other_frame),
            "frame 'camera', which does not say that it is optical: give --axes",
        ),
    ],
    ids=["info", "tf_static", "nan", "child", "frame"],
)
def test_what_a_bag_lacks_is_named(tmp_path, given, words):
    bag = fb.write(tmp_path / "a.bag", given)
    with pytest.raises(InputError, match=words):
        import_bag([bag], tmp_path / "out", asked())
    assert not (tmp_path / "out").exists()


def test_single_wrong_poses_are_left_out_and_said(tmp_path):
    count = iter(range(1000))
    bag = fb.write(
        tmp_path / "a.bag", spoilt("/odom", lambda m: nan(m) if next(count) == 40 else None)
    )
    done = import_bag([bag], tmp_path / "out", asked())
    assert (truth(done) < 1e-6).all()
    assert any("/odom: 1 message is left out: pose is not finite" in w for w in done.warnings)


def test_axes_of_a_frame_that_is_not_named_optical(tmp_path):
    """The pictures name camera_link, whose x looks forward."""

    def link(message):
        message.header.frame_id = "camera_link"

    bag = fb.write(tmp_path / "a.bag", spoilt("/cam/image_raw", link))
    assert (truth(import_bag([bag], tmp_path / "out", asked(axes="camera"))) < 1e-6).all()
    wrong = import_bag([bag], tmp_path / "wrong", asked(mount="camera", pose="/odom"))
    assert truth(wrong)[1] > 0.1  # a mount of one's own counts, without tf


@pytest.mark.parametrize(
    "kind, words",
    [
        ("sqlite3", "cannot be read as a bag.*if it was cut: sqlite3 FILE .recover"),
        ("plain mcap", "cannot be read as a bag.*if it was cut: mcap recover"),
    ],
)
def test_a_cut_bag_of_ros2_is_named(bags, tmp_path, kind, words):
    source = next(bags[kind].glob("*.db3")) if kind == "sqlite3" else bags[kind]
    cut = tmp_path / source.name
    cut.write_bytes(source.read_bytes()[: source.stat().st_size // 2])
    with pytest.raises(InputError, match=words):
        import_bag([cut], tmp_path / "out", asked())


def test_a_cut_bag_of_ros1_is_repaired_and_said(bags, tmp_path):
    cut = tmp_path / "cut.bag"
    cut.write_bytes(bags["ros1"].read_bytes()[: int(0.9 * bags["ros1"].stat().st_size)])
    done = import_bag([cut], tmp_path / "out", asked())
    assert any("was not closed or is damaged: repaired" in w for w in done.warnings)
    assert (truth(done) < 1e-6).all() and (tmp_path / "cut.bag.broken").exists()


def test_a_damaged_picture_is_replaced(tmp_path):
    bag = fb.write(tmp_path / "a.bag", entries())
    first = import_bag([bag], tmp_path / "first", asked(topic="/jpg/image_raw"))
    bad_s = first.pictures[0].posed.own_stamp_s

    def cut(message):
        if abs(message.header.stamp.to_sec() - bad_s) < 0.01:
            message.data = message.data[:200]

    bag = fb.write(tmp_path / "b.bag", spoilt("/jpg/image_raw/compressed", cut))
    done = import_bag([bag], tmp_path / "out", asked(topic="/jpg/image_raw"))
    assert bad_s not in [d.posed.own_stamp_s for d in done.pictures] and len(done.pictures) >= 4
    assert any("compressed picture ends early" in w for w in done.warnings)


def test_a_folder_that_is_not_empty_stays(bags, tmp_path):
    (tmp_path / "mine").write_text("")
    with pytest.raises(OutputError, match="is not empty"):
        import_bag([bags["ros1"]], tmp_path, asked())


def test_map_of_a_foreign_bag_names_the_import(bags):
    for kind in KINDS:
        with pytest.raises(InputError) as error:
            read_session(bags[kind])
        said = str(error.value)
        assert (
            f"fcsv import-bag {bags[kind]} --camera /cam/image_raw --pose /odom --range-m M -o PHOTOS"
            in said
        )
        assert (
            "/jpg/image_raw/compressed (sensor_msgs/CompressedImage)" in said
            and "/pose_cov" in said
        )


# ---- cameras ----


def test_distortion_that_colmap_cannot_say_is_taken_out(tmp_path):
    bent = PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5, (-0.2, 0.05, 0.0, 0.0, 0.01))

    def change(message):
        message.D, message.K = list(bent.distortion), bent.K.ravel().tolist()

    bag = fb.write(tmp_path / "a.bag", spoilt("/cam/camera_info", change))
    done = import_bag([bag], tmp_path / "out", asked(most=2))
    (camera,) = read_model(tmp_path / "out")[0].values()
    assert not any(camera.distortion) and any("undistorted and cropped" in w for w in done.warnings)
    corners = np.array([[0.0, 0.0], [63.0, 0.0], [0.0, 47.0], [63.0, 47.0]])
    rays = np.hstack([camera.normalize(corners), np.ones((4, 1))])
    seen = bent.project(rays)  # where the written picture's corners lie in the recorded one: inside
    assert (seen > -1.0).all() and (seen < [64.0, 48.0]).all()


def test_rectified_pictures_have_the_camera_of_p(tmp_path):
    R = transforms.from_xyz_rpy([0, 0, 0], [0.0, 0.02, 0.0])[:3, :3]
    P = np.array([[50.0, 0, 31.5, 0], [0, 50.0, 23.5, 0], [0, 0, 1, 0]])

    def change(message):
        message.D, message.R, message.P = (
            [-0.2, 0.05, 0, 0, 0.01],
            R.ravel().tolist(),
            P.ravel().tolist(),
        )

    def renamed(topic, message, stamp_s):
        if topic == "/cam/camera_info":
            change(message)
        return [("/cam/image_rect_color" if topic == "/cam/image_raw" else topic, message, stamp_s)]

    bag = fb.write(tmp_path / "a.bag", entries(renamed))
    done = import_bag([bag], tmp_path / "out", asked(topic="/cam/image_rect_color"))
    (camera,) = read_model(tmp_path / "out")[0].values()
    assert camera.fx == 50.0 and not any(camera.distortion)
    for d in done.pictures:
        T = fb.T_odom_base(d.posed.stamp_s) @ fb.T_BASE_OPTICAL
        assert transforms.rotation_angle(T[:3, :3] @ R.T, d.posed.T_world_cam) < 1e-6


# ---- to the end ----


def test_a_drawn_pair_through_mcap_has_its_depth(tmp_path, capsys):
    """Two cameras that stand, 0.8 m apart, a wall at 20 m with one at 12 m before it."""
    places = {"left": [0.0, 0.0, 0.0], "right": [0.0, -0.8, 0.0]}
    given = []
    for name, place in places.items():
        rgb, frame = photograph(camera_pose(place)), f"{name}_optical"
        for i in range(3):
            s = 1000.0 + 0.1 * i
            given.append((f"/{name}/image_raw", fb.image(s, rgb, frame), s))
            given.append((f"/{name}/camera_info", fb.info(s, CAMERA, frame), s))
            for t in (s - 0.04, s + 0.03):
                given.append((f"/{name}/pose", fb.pose(t, camera_pose(place), "world"), t))
    bag = to_ros2([fb.write(tmp_path / "pair.bag", given)], tmp_path / "pair", "mcap")
    (mcap,) = bag.glob("*.mcap")
    cameras = [w for n in places for w in ("--camera", f"/{n}/image_raw", "--pose", f"/{n}/pose")]
    photos, out = tmp_path / "photos", tmp_path / "map"
    arguments = [str(mcap), *cameras, "--mount", "optical", "--range-m", "20", "-o", str(photos)]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert (
        "images/ (2)" in said and "--reference camera1_01.png" in said and "frame 'world'" in said
    )
    assert cli.main([str(photos), "-o", str(out), "--reference", "camera1_01.png", "--rig"]) == 0
    depth, expected = np.load(out / "depth.npy"), true_depth(camera_pose(places["left"]))
    known = np.isfinite(depth)
    assert known.mean() > 0.6
    error = np.abs(depth - expected)[known] / expected[known]
    # 0.8 m and 301 px: a quarter of a pixel at 20 m is 2 %
    assert np.median(error) < 0.02 and (error < 0.1).mean() > 0.9


def test_the_command_says_what_is_wrong_in_one_line(bags, tmp_path, capsys):
    arguments = [
        str(bags["ros1"]),
        "--camera",
        "/kam",
        "--pose",
        "/odom",
        "--range-m",
        "20",
        "-o",
        str(tmp_path / "o"),
    ]
    assert main(arguments) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert main([str(tmp_path / "no.bag"), *arguments[1:]]) == 2
    assert "no.bag: does not exist" in capsys.readouterr().err
    assert main([*arguments, "--mount", "optical", "--mount", "camera"]) == 2
    assert "--mount is given 2 times for 1 camera:" in capsys.readouterr().err
