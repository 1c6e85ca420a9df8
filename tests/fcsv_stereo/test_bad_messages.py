# SPDX-License-Identifier: Apache-2.0
"""Single bad messages of a session are left out and named, the rest makes the map; what cannot be
mapped has a sentence of its own."""

import random
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
import rosbag
from support.ros2_bags import PLUGINS, session_to_ros2
from support.scenes import CAMERA, photograph
from support.sessions import T0, T_HOME_CAM, write_depth, write_session
from support.spoiled import compressed, every, one, retyped, spoil

from fcsv_geometry.ros import conversions
from fcsv_stereo import pipeline
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.errors import InputError, MatchingError
from fcsv_stereo.sessions import read_session
from fcsv_stereo.thesis import ThesisOptions

INFO, RAW, ODOMETRY = "camera/color/camera_info", "camera/color/image_raw", "odometry/body"
NAN = float("nan")
AREA = "Sessions and bags"
_NO_COVARIANCE = "how well the poses of"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_session(tmp_path_factory.mktemp("whole") / "session")


@pytest.fixture
def session(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "session")


@pytest.fixture(scope="module")
def right(whole):
    return pictures(read_session(whole))


def pictures(given):
    (c,) = given.configurations
    return {p.name: p for p in (*c.references, *c.others)}


def said(given):
    return [w for w in given.warnings if _NO_COVARIANCE not in w]


def same_but(given, right, lost=0):
    """All pictures but so many, with the poses, cameras and pixels of the unspoilt session."""
    found = pictures(given)
    assert len(found) == len(right) - lost and set(found) <= set(right)
    for name, p in found.items():
        assert p.camera == right[name].camera and np.array_equal(p.image, right[name].image)
        assert np.allclose(p.T_home_cam, right[name].T_home_cam, atol=1e-9)


def put(path, *values):
    """A change of a message: its field ``path`` becomes the value, or each of the fields of
    ``path`` its own."""

    def change(message):
        for dotted, value in zip(path.split(), values):
            *outer, name = dotted.split(".")
            target = message
            for part in outer:
                target = getattr(target, part)
            setattr(target, name, value)

    return change


def stamp(stamp_s):
    return lambda message: setattr(message.header, "stamp", conversions.header(stamp_s, "").stamp)


def ahead(by_s):
    return lambda message: setattr(
        message.header, "stamp", message.header.stamp + conversions.rospy.Duration(by_s)
    )


def shorter(message):
    message.data = message.data[:-200]


def swapped_K(message):
    message.K = np.reshape(message.K, (3, 3)).T.ravel().tolist()


def scaled_K(factor):
    def change(message):
        message.K = [
            factor * message.K[0],
            0.0,
            message.K[2],
            0.0,
            factor * message.K[4],
            message.K[5],
            0.0,
            0.0,
            1.0,
        ]

    return change


_P = "pose.pose.position.x"
_Q = "pose.pose.orientation.x pose.pose.orientation.y pose.pose.orientation.z pose.pose.orientation.w"

SINGLE = [
    ("one camera_info with K = 0", INFO, put("K", [0.0] * 9), "not calibrated (K is zero)"),
    ("one camera_info with K transposed", INFO, swapped_K, "K is transposed"),
    ("one camera_info with D of 3", INFO, put("D", [0.1, 0.2, 0.3]), "D has 3 coefficients"),
    (
        "one camera_info of a fisheye",
        INFO,
        put("distortion_model", "equidistant"),
        "is of a fisheye",
    ),
    (
        "one camera_info with a focal length 30 % longer",
        INFO,
        scaled_K(1.3),
        "intrinsics of this message alone are",
    ),
    (
        "one camera_info with a focal length 5 % longer",
        INFO,
        scaled_K(1.05),
        "intrinsics of this message alone are",
    ),
    (
        "one camera_info of another size",
        INFO,
        put("width height", 300, 220),
        "of this message alone are 300x220",
    ),
    ("one odometry message with NaN", ODOMETRY, put(_P, NAN), "pose is not finite"),
    (
        "one odometry message with a zero quaternion",
        ODOMETRY,
        put(_Q, 0.0, 0.0, 0.0, 0.0),
        "has length 0, not 1",
    ),
    (
        "one odometry message 1 km away",
        ODOMETRY,
        put(_P, 1000.0),
        "its pose is far from those before and after",
    ),
    (
        "one odometry message turned by 180 degrees",
        ODOMETRY,
        put(_Q, 1.0, 0.0, 0.0, 0.0),
        "its pose is far from",
    ),
    ("one odometry stamp of 0", ODOMETRY, stamp(0.0), "its stamp is 0"),
    ("one odometry stamp 60 s ahead", ODOMETRY, ahead(60.0), "s after its neighbours"),
    ("one odometry stamp 60 s back", ODOMETRY, ahead(-60.0), "s before its neighbours"),
    ("one odometry stamp years ahead", ODOMETRY, ahead(1e8), "s after its neighbours"),
]


@pytest.mark.parametrize("number", [0, 2, -1])
@pytest.mark.parametrize("name, topic, change, words", SINGLE)
def test_a_single_bad_message_is_left_out_and_named(
    session, right, name, topic, change, words, number, wrong_input
):
    number = number if number >= 0 else (3 if topic == INFO else 59)
    spoil(session / "uav2.bag", topic, one(number, change))
    given = read_session(session)
    (line,) = said(given)
    assert (
        f"topic /uav2/{topic}: 1 message is left out: " in line
        and words in line
        and "(stamp " in line
    )
    same_but(given, right)
    wrong_input(AREA, name, "left out and named", words)


PICTURES = [
    ("one picture that is cut short", shorter, "bytes where height x step is"),
    (
        "one picture of another size",
        put("width height step data", 10, 10, 30, bytes(300)),
        "picture is 10x10",
    ),
    ("one picture of an unknown encoding", put("encoding", "yuv999"), "encoding 'yuv999'"),
    ("one picture's stamp of 0", stamp(0.0), "its stamp is"),
    ("one picture's stamp far ahead", ahead(3600.0), "its stamp is"),
    ("one picture's stamp far back", ahead(-700.0), "its stamp is"),
]


@pytest.mark.parametrize("number", [0, 1, 3])
@pytest.mark.parametrize("name, change, words", PICTURES)
def test_a_single_bad_picture_is_left_out_and_named(
    session, right, name, change, words, number, wrong_input
):
    spoil(session / "uav1.bag", RAW, one(number, change))
    given = read_session(session)
    (line,) = said(given)
    assert f"topic /uav1/{RAW}: 1 message is left out: " in line and words in line
    same_but(given, right, lost=1)
    wrong_input(AREA, name, "left out and named", words)


def test_a_single_frozen_stamp(session, right, wrong_input):
    spoil(session / "uav1.bag", RAW, one(2, stamp(T0 + 0.35)))
    given = read_session(session)
    (line,) = said(given)
    assert (
        f"topic /uav1/{RAW}: 1 message is left out: its stamp is that of the message before" in line
    )
    same_but(given, right, lost=1)
    words = "its stamp is that of the message before"
    wrong_input(AREA, "one picture with the stamp of the one before", "left out and named", words)


def garbled(bag_path, topic_end, number):
    """The bytes of one message, as a damaged disk leaves them, in a bag that is otherwise whole."""
    with rosbag.Bag(str(bag_path)) as source:
        messages = list(source.read_messages(raw=True))
    with rosbag.Bag(str(bag_path), "w") as target:
        count = 0
        for topic, (kind, data, md5, *rest), t in messages:
            if topic.endswith(topic_end):
                data, count = (data[: len(data) // 2] if count == number else data), count + 1
            target.write(topic, (kind, data, md5, *rest), t, raw=True)


def test_a_message_whose_bytes_are_none_of_its_type(session, right, wrong_input):
    garbled(session / "uav2.bag", ODOMETRY, 7)
    garbled(session / "uav1.bag", RAW, 1)
    given = read_session(session)
    lines = said(given)
    assert len(lines) == 2 and all(
        "1 message is left out: its bytes are no " in line for line in lines
    ), lines
    same_but(given, right, lost=1)
    wrong_input(
        AREA,
        "one message cut short in a bag that is whole",
        "left out and named",
        "its bytes are no message of its type",
    )


WRONG_ALL = [
    (
        "camera_info that is never calibrated",
        INFO,
        put("K", [0.0] * 9),
        f"{INFO}: none of its 4 messages can be used",
    ),
    (
        "camera_info that alternates between two cameras",
        INFO,
        None,
        "intrinsics differ from message to message",
    ),
    (
        "odometry of NaN alone",
        ODOMETRY,
        put(_P, NAN),
        f"{ODOMETRY}: none of its 60 messages can be used",
    ),
    (
        "odometry with stamps of 0 alone",
        ODOMETRY,
        stamp(0.0),
        "all stamps are 0: does the driver fill header.stamp?",
    ),
    (
        "odometry with a stamp that stands still",
        ODOMETRY,
        stamp(T0),
        "all stamps stand still at 1000.000",
    ),
    (
        "odometry whose clock is 100 s ahead",
        ODOMETRY,
        ahead(100.0),
        "4 pictures have no odometry at their stamp",
    ),
    (
        "pictures with stamps of 0 alone",
        RAW,
        stamp(0.0),
        f"{RAW}: all stamps are 0: does the driver fill",
    ),
    (
        "pictures with a stamp that stands still",
        RAW,
        stamp(T0 + 0.3),
        f"{RAW}: all stamps stand still at 1000.300",
    ),
    ("pictures whose clock is 100 s ahead", RAW, ahead(100.0), "is its clock 99 s ahead?"),
    ("pictures whose clock is 100 s behind", RAW, ahead(-100.0), "is its clock 99 s behind?"),
    ("pictures that are all cut short", RAW, shorter, f"{RAW}: 4 messages are left out"),
]


@pytest.mark.parametrize("name, topic, change, words", WRONG_ALL)
def test_what_is_wrong_all_the_time_has_a_sentence_of_its_own(
    session, name, topic, change, words, wrong_input
):
    alternates = lambda i, m: m if i % 2 else (scaled_K(1.2)(m), m)[1]  # noqa: E731
    spoil(session / "uav2.bag", topic, every(change) if change else alternates)
    with pytest.raises(InputError) as error:
        read_session(session)
    assert words in str(error.value) and "\n" not in str(error.value), str(error.value)
    wrong_input(
        AREA,
        name,
        "refused",
        words.split(": ", 1)[-1] if words[:6] in (RAW[:6], ODOMETRY[:6]) else words,
    )


def test_no_pictures_and_pictures_that_nobody_reads(session, wrong_input):
    other = shutil.copytree(session, session.parent / "other")
    spoil(session / "uav2.bag", RAW, lambda *_: None)
    words = f"no picture of uav2 was recorded: topics /uav2/{RAW} and /uav2/{RAW}/compressed are missing"
    with pytest.raises(InputError, match=words):
        read_session(session)
    wrong_input(AREA, "no pictures of a vehicle", "refused", "no picture of uav2 was recorded")
    retyped(other / "uav2.bag", RAW, RAW + "/theora", lambda m: compressed(m, b"", "theora"))
    words = f"of uav2 only /uav2/{RAW}/theora was recorded, which is not read: record /uav2/{RAW}"
    with pytest.raises(InputError, match=words):
        read_session(other)
    wrong_input(
        AREA,
        "pictures of image_transport's theora alone",
        "refused",
        "was recorded, which is not read",
    )


# ---- compressed pictures -------------------------------------------------------------------------


def encoded(image, suffix, words="bgr8; {} compressed bgr8"):
    bgr = cv2.cvtColor(conversions.image_to_array(image), cv2.COLOR_RGB2BGR)
    data = cv2.imencode(suffix, bgr, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    return compressed(image, data, words.format(suffix[1:].replace("jpg", "jpeg")))


def compress(session, suffix=".png", **options):
    for vehicle in ("uav1", "uav2"):
        bag = session / f"{vehicle}.bag"
        retyped(bag, RAW, RAW + "/compressed", lambda m: encoded(m, suffix, **options))
    return session


@pytest.mark.parametrize("words", ["rgb8; {} compressed bgr8", "{}", "bgr8; {} compressed bgr8"])
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_compressed_pictures_are_read(session, right, suffix, words, wrong_input):
    given = read_session(compress(session, suffix, words=words))
    assert said(given) == []
    for name, p in pictures(given).items():
        assert np.abs(p.image.astype(int) - right[name].image).mean() < (
            0.01 if suffix == ".png" else 2.0
        )
        assert np.allclose(p.T_home_cam, right[name].T_home_cam)
    wrong_input(AREA, "only image_raw/compressed (JPEG or PNG)", "read right")


@pytest.mark.parametrize("storage", PLUGINS)
def test_compressed_pictures_of_ros2(session, right, tmp_path, storage):
    given = read_session(session_to_ros2(compress(session), tmp_path / "ros2", storage))
    same_but(given, right)


def test_red_first_and_grey_and_16_bits_are_what_they_say(session, right):
    def turned(image):
        return compressed(image, encoded(image, ".png").data, "rgb8; png compressed rgb8")

    retyped(session / "uav1.bag", RAW, RAW + "/compressed", turned)
    found = {n: p for n, p in pictures(read_session(session)).items() if n.startswith("uav1")}
    assert all(np.array_equal(p.image, right[n].image[..., ::-1]) for n, p in found.items())


def test_raw_pictures_are_preferred(session, right):
    with rosbag.Bag(str(session / "uav1.bag"), "a") as bag:
        black = conversions.array_to_image(
            np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8), "rgb8", T0 + 0.2, "c"
        )
        bag.write(f"/uav1/{RAW}/compressed", encoded(black, ".png"), black.header.stamp)
    same_but(read_session(session), right)


@pytest.mark.parametrize(
    "spoilt, words",
    [
        (lambda data: data[: len(data) // 2], "compressed picture ends early"),
        (lambda _: b"", "is neither JPEG nor PNG"),
        (lambda _: b"\x00" * 999, "is neither JPEG nor PNG"),
    ],
)
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_single_bad_compressed_picture(session, right, suffix, spoilt, words, wrong_input):
    compress(session, suffix)
    spoil(
        session / "uav1.bag",
        RAW + "/compressed",
        one(1, lambda m: setattr(m, "data", spoilt(m.data))),
    )
    given = read_session(session)
    (line,) = said(given)
    assert f"topic /uav1/{RAW}/compressed: 1 message is left out: " in line and words in line
    assert len(pictures(given)) == len(right) - 1
    wrong_input(
        AREA, "one compressed picture that is cut short or none", "left out and named", words
    )


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_compressed_picture_that_is_damaged_inside(session, right, suffix, wrong_input):
    """Its end is there, so that OpenCV shows something."""

    def damaged(message):
        data = bytearray(message.data)
        third = len(data) // 3
        data[third : 2 * third] = bytes(third)
        message.data = bytes(data)

    compress(session, suffix)
    spoil(session / "uav1.bag", RAW + "/compressed", one(1, damaged))
    given = read_session(session)
    (line,) = said(given)
    assert (
        f"topic /uav1/{RAW}/compressed: 1 message is left out: " in line
        and "is damaged inside" in line
    )
    assert len(pictures(given)) == len(right) - 1
    wrong_input(
        AREA,
        "one compressed picture that is damaged inside",
        "left out and named",
        "is damaged inside",
    )


# ---- cameras that change -------------------------------------------------------------------------

SMALL = replace(
    CAMERA, width=240, height=180, fx=0.75 * CAMERA.fx, fy=0.75 * CAMERA.fy, cx=119.5, cy=89.5
)
ZOOMED = replace(CAMERA, fx=1.25 * CAMERA.fx, fy=1.25 * CAMERA.fy)


def change_camera(session, vehicle, camera):
    """From the third of four pictures on."""

    def changed(i, message):
        stamp_s, frame_id = message.header.stamp.to_sec(), message.header.frame_id
        if i < 2:
            return message
        if message._type.endswith("CameraInfo"):
            return conversions.info_from_camera(camera, stamp_s, frame_id)
        return conversions.array_to_image(
            photograph(T_HOME_CAM[vehicle], camera), "rgb8", stamp_s, frame_id
        )

    for topic in (INFO, RAW):
        spoil(session / f"{vehicle}.bag", topic, changed)


@pytest.mark.parametrize("camera", [SMALL, ZOOMED], ids=["resolution", "zoom"])
def test_a_camera_that_changes_is_used_each_for_its_pictures(
    session, camera, tmp_path, wrong_input
):
    change_camera(session, "uav2", camera)
    given = read_session(session)
    (line,) = said(given)
    assert f"topic /uav2/{INFO}: the camera changes at stamp 1000.600 from 320x240" in line
    cameras = [p.camera for p in given.configurations[0].others]
    assert cameras == [CAMERA, CAMERA, camera, camera]
    if camera is ZOOMED:
        return
    document = pipeline.run(pipeline.MapRequest(session, tmp_path / "map", "joint"))
    depth = np.load(tmp_path / "map" / "depth.npy")
    assert 19.5 < np.nanmedian(depth) < 20.5 and any(
        "the camera changes at" in w for w in document["warnings"]
    )
    wrong_input(
        AREA,
        "a camera whose zoom or resolution changes for good",
        "read, with a warning",
        "each picture is mapped with the intrinsics of its own time",
    )


def test_the_thesis_matches_no_pictures_of_two_sizes(session, tmp_path):
    bag = session / "uav2.bag"
    small = photograph(T_HOME_CAM["uav2"], SMALL)
    spoil(
        bag, INFO, lambda _i, m: conversions.info_from_camera(SMALL, m.header.stamp.to_sec(), "c")
    )
    spoil(
        bag,
        RAW,
        lambda _i, m: conversions.array_to_image(small, "rgb8", m.header.stamp.to_sec(), "c"),
    )
    options = ThesisOptions(threshold=ErrorThreshold(5.0, False))
    with pytest.raises(MatchingError, match="these matchers need pictures of one size"):
        pipeline.run(pipeline.MapRequest(session, tmp_path / "map", "thesis", options))


def test_a_driver_that_estimates_its_camera_anew_is_believed(session):
    spoil(session / "uav2.bag", INFO, lambda i, m: (scaled_K(1.0 + 0.001 * i)(m), m)[1])
    given = read_session(session)
    focal = [p.camera.fx for p in given.configurations[0].others]
    assert said(given) == [] and focal == sorted(set(focal)) and len(focal) == 4


# ---- clocks, copies, depth -----------------------------------------------------------------------


def test_a_clock_that_jumps_back_is_told(session, wrong_input):
    spoil(session / "uav2.bag", ODOMETRY, lambda i, m: (ahead(-0.8)(m) if i >= 45 else None, m)[1])
    given = read_session(session)
    assert any(
        "the clock jumps back by" in w and f"/uav2/{ODOMETRY}" in w for w in given.warnings
    ), given.warnings
    wrong_input(
        AREA,
        "a tracker's clock that jumps back",
        "read, with a warning",
        "the time that it counts twice is left out",
    )


@pytest.mark.parametrize(
    "name", ["uav1 (1).bag", "copy of uav1.bag", "uav1_copy.bag", "uav1.2.bag"]
)
@pytest.mark.parametrize("listed", [False, True])
def test_a_bag_copied_twice_into_one_folder_counts_once(session, right, name, listed, wrong_input):
    shutil.copy(session / "uav1.bag", session / name)
    if listed:
        (session / "session.yaml").write_text(
            f"bags: {{uav1: uav1.bag, a: '{name}', uav2: uav2.bag, c: control.bag}}\n"
        )
    else:
        (session / "session.yaml").unlink()
    given = read_session(session)
    (line,) = said(given)
    assert "is a copy of" in line and "left out; delete one of them" in line
    same_but(given, right)
    wrong_input(
        AREA,
        "a bag copied twice into one folder",
        "left out and named",
        "left out; delete one of them",
    )


def test_a_copy_that_was_cut_counts_once(session, right, wrong_input):
    data = (session / "uav1.bag").read_bytes()
    (session / "uav1 (1).bag").write_bytes(data[: len(data) * 7 // 10])
    (session / "session.yaml").unlink()
    given = read_session(session)
    assert any("holds what" in w and "counted once" in w for w in given.warnings), given.warnings
    same_but(given, right)
    wrong_input(
        AREA, "a bag and a part of its copy in one folder", "read, with a warning", "counted once"
    )


@pytest.mark.parametrize("compression", ["lz4", "bz2"])
def test_a_cut_bag_with_compressed_chunks_is_repaired(session, compression, wrong_input):
    with rosbag.Bag(str(session / "uav2.bag")) as source:
        messages = list(source.read_messages())
    with rosbag.Bag(
        str(session / "uav2.bag"), "w", compression=compression, chunk_threshold=100000
    ) as bag:
        for topic, message, t in messages:
            bag.write(topic, message, t)
    data = (session / "uav2.bag").read_bytes()
    (session / "uav2.bag").write_bytes(data[: len(data) * 8 // 10])
    given = read_session(session)
    assert any("uav2.bag was not closed or is damaged: repaired, " in w for w in given.warnings), (
        given.warnings
    )
    assert (
        1 <= len(given.configurations[0].others) < 4
        and len(given.configurations[0].references) == 4
    )
    wrong_input(
        AREA,
        f"a cut bag with chunks of {compression}",
        "read, with a warning",
        "was not closed or is damaged: repaired",
    )


def test_parts_of_a_session_without_a_description_are_read_in_order(session, right):
    with rosbag.Bag(str(session / "uav1.bag")) as source:
        messages = list(source.read_messages())
    for name, kept in (
        ("uav1.bag", lambda t: t < T0 + 0.5),
        ("uav1.1.bag", lambda t: t >= T0 + 0.5),
    ):
        with rosbag.Bag(str(session / name), "w") as bag:
            for topic, message, t in messages:
                if kept(t.to_sec()):
                    bag.write(topic, message, t)
    (session / "session.yaml").unlink()
    given = read_session(session)
    assert said(given) == []
    same_but(given, right)


def test_a_single_bad_depth_frame_is_left_out_and_named(session):
    for vehicle in T_HOME_CAM:
        with rosbag.Bag(str(session / f"{vehicle}.bag"), "a") as bag:
            write_depth(bag, vehicle, np.full((CAMERA.height, CAMERA.width), 3000, np.uint16), ())
    spoil(session / "uav1.bag", "aligned_depth_to_color/image_raw", one(1, shorter))
    given = read_session(session)
    frames = list(given.near.frames())
    assert frames and any(
        "1 message is left out" in w and "bytes where" in w for w in given.near.warnings
    )


@pytest.mark.parametrize(
    "topic, change, words",
    [
        ("/home", put("home_in_odom.position.x", NAN), "topic /home: the newest message is none"),
        (
            "/mission/capture",
            put("configuration.baseline_m", NAN),
            "its configuration has a baseline of nan m",
        ),
        (
            "/mission/capture",
            put("stop", conversions.header(1.0, "").stamp),
            "its window ends at 1.000, before it begins",
        ),
        (
            "/calibration",
            lambda m: put("child_odom_in_parent_odom.position.x", NAN)(m.links[0]),
            "topic /calibration: the",
        ),
    ],
)
def test_what_the_control_pc_told_wrongly_is_named(session, topic, change, words):
    spoil(session / "control.bag", topic, one(0, change))
    with pytest.raises(InputError, match=words):
        read_session(session)


@pytest.mark.parametrize(
    "change, words",
    [
        (put("pose.covariance", [NAN] * 36), "holds NaN"),
        (put(_P, NAN), "pose is not finite"),
        (ahead(60.0), "its stamp is"),
    ],
)
def test_a_single_bad_camera_pose_is_left_out_and_named(tmp_path, change, words):
    covariance = np.diag([0.01**2] * 3 + [0.003**2] * 3)
    session = write_session(tmp_path / "session", covariance=covariance)
    spoil(session / "control.bag", "uav2/camera_pose", one(15, change))
    given = read_session(session)
    (line,) = given.warnings
    assert "topic /uav2/camera_pose: 1 message is left out: " in line and words in line
    assert all(p.covariance is not None for p in pictures(given).values())


# ---- anything ------------------------------------------------------------------------------------


def corruption(draw, topic):
    """A change of one message that a driver, a radio or a disk might make."""
    if topic == INFO:
        value, where = draw.choice([NAN, 0.0, -1.0, 1e-310, 1e9, 65535.0]), draw.choice([0, 4])
        return draw.choice(
            [
                lambda m: setattr(m, "K", [value if i == where else k for i, k in enumerate(m.K)]),
                put("D", [value] * draw.choice([1, 3, 6, 7])),
                put("D", [NAN] * 5),
                put("distortion_model", "fisheye"),
                put("width", draw.choice([0, 7, 100000])),
                scaled_K(draw.choice([0.5, 0.9, 1.02, 1.5, 7.0])),
                swapped_K,
            ]
        )
    at = stamp(draw.choice([0.0, 1.0, 500.0, 1e6, 2e9]))
    if topic == RAW:
        return draw.choice(
            [shorter, put("encoding", "?"), put("height", 9), put("step", 1), put("data", b""), at]
        )
    value = draw.choice([NAN, float("inf"), 1e30, -4000.0])
    field = "pose.pose." + draw.choice(
        ["position.x", "position.z", "orientation.w", "orientation.y"]
    )
    return draw.choice([put(field, value), put(_Q, 0.0, 0.0, 0.0, 0.0), at])


@pytest.mark.parametrize("seed", range(24))
def test_no_single_message_costs_the_map_or_passes_in_silence(session, right, seed):
    draw = random.Random(seed)
    vehicle, topic = draw.choice(["uav1", "uav2"]), draw.choice([INFO, RAW, ODOMETRY])
    number = draw.randrange(60 if topic == ODOMETRY else 4)
    spoil(session / f"{vehicle}.bag", topic, one(number, corruption(draw, topic)))
    given = read_session(session)
    lines = said(given)
    assert len(lines) == 1 and f"topic /{vehicle}/{topic}: 1 message is left out: " in lines[0], (
        lines
    )
    same_but(given, right, lost=int(topic == RAW))
