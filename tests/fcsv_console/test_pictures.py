# SPDX-License-Identifier: Apache-2.0
"""Pictures: each camera's with its tags, the map's with its depth; one that cannot be shown is
told."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.waiting import within

from fcsv_console.model import facts, pictures, samples
from fcsv_console.model.console import Console

until = within(10.0)

OUTDOOR = str(Path(__file__).resolve().parents[2] / "config/missions/outdoor.yaml")
CORNERS = ((294.5, 235.5), (325.5, 235.5), (325.5, 204.5), (294.5, 204.5))
CAMERA = "camera/color/image_raw/compressed"


def jpeg(grey):
    return cv2.imencode(".jpg", np.full((480, 640, 3), grey, np.uint8))[1].tobytes()


def camera(c, now_s, name="uav2"):
    return next(p for p in c.view(now_s).cameras if p.vehicle == name)


def reference(width=4, height=2, value=90):
    return facts.MapPicture("reference", width, height, bytes([value]) * (3 * width * height))


def depth(values):
    a = np.asarray(values, "<f4")
    return facts.MapPicture("depth", a.shape[1], a.shape[0], a.tobytes())


# ---- what is decided -----------------------------------------------------------------------------


def test_a_picture_has_its_rate_its_age_and_the_tags_of_its_moment():
    c = Console(["uav1", "uav2"])
    assert camera(c, 0.0).words == "uav2: no picture was heard"
    for k in range(4):
        c.tell(10.0 + k, facts.PreviewReport("uav2", 50.0 + k, b"\xff\xd8"))
    c.tell(13.1, facts.TagReport("uav2", (1,), (CORNERS,), 53.05))
    found = camera(c, 13.4)
    assert found.words == "uav2: 1.0 Hz, 0.4 s old, tag 1" and found.outlines == (CORNERS,)
    c.tell(14.0, facts.TagReport("uav2", (1,), (CORNERS,), 53.9))
    assert camera(c, 14.1).outlines == (), "an outline of another moment would lie beside the tag"
    assert camera(c, 16.0).words == "uav2: STOPPED 3.0 s ago"


def test_one_that_cannot_be_shown_is_named_until_a_good_one_comes():
    c = Console(["uav1", "uav2"])
    c.tell(10.0, facts.PreviewReport("uav2", 10.0, b"\xff\xd8"))
    c.tell(
        11.0,
        facts.Unusable("uav2", CAMERA, "encoding '13UC5' with 2 octets is no JPEG or PNG picture"),
    )
    assert camera(c, 60.0).words == "uav2: encoding '13UC5' with 2 octets is no JPEG or PNG picture"
    assert camera(c, 60.0, "uav1").problem == ""
    c.tell(61.0, facts.PreviewReport("uav2", 61.0, b"\xff\xd8"))
    assert camera(c, 61.1).problem == ""
    c.tell(62.0, facts.Unusable("", "/map/depth", "encoding '13UC5' is no depth"))
    assert c.view(62.0).map_pictures.words == "map: encoding '13UC5' is no depth"
    c.tell(63.0, depth(np.ones((2, 4))))
    assert c.view(63.0).map_pictures.words == "map: no reference picture yet"


def test_the_match_rate_is_the_share_of_pixels_with_a_depth():
    c = Console(["uav1", "uav2"])
    c.tell(1.0, reference())
    assert c.view(1.0).map_pictures.words == "map: no depth yet"
    c.tell(2.0, depth([[1.0, np.nan, 3.0, 4.0], [np.nan, np.nan, 5.0, np.inf]]))
    shown = c.view(2.0).map_pictures
    assert shown.match == 0.5 and shown.words == "map: 50% have a depth"
    c.tell(3.0, reference(8, 2))
    assert c.view(3.0).map_pictures.words == "map: depth is 4 x 2, its picture 8 x 2"
    assert c.view(3.0).map_pictures.depth is None, "a depth is never laid over another picture"


def test_depth_lies_over_the_grey_picture_near_yellow_and_far_violet():
    picture = np.full((1, 200, 3), (30, 90, 150), np.uint8)
    z = np.concatenate([np.full(80, 5.0), np.full(80, 300.0), np.full(40, np.nan)])[None].astype(
        np.float32
    )
    over = pictures.overlaid(picture, z)
    assert (over[0, 180] == 90).all(), "without a depth: grey"
    near, far = over[0, 10].astype(int), over[0, 100].astype(int)
    assert near[0] > near[2] + 80 and far[2] > far[1] + 40
    assert (pictures.overlaid(picture, np.full((1, 200), np.nan, np.float32)) == 90).all()
    assert pictures.overlaid(picture, None) is picture
    assert np.isfinite(pictures.overlaid(picture, np.full((1, 200), 7.0, np.float32))).all(), (
        "a wall of one depth"
    )


# ---- messages ------------------------------------------------------------------------------------


def test_messages_become_pictures_and_wrong_ones_are_refused():
    from sensor_msgs.msg import Image

    from fcsv_console.ros import messages
    from fcsv_geometry.errors import GeometryError
    from fcsv_geometry.ros import conversions
    from fcsv_msgs.msg import TagDetection, TagDetections

    def convert(topic, message):
        return messages.OF_CONTROL[topic][1]("", message)

    bgr = np.zeros((2, 3, 3), np.uint8)
    bgr[..., 0] = 200
    told = convert("/map/reference", conversions.array_to_image(bgr, "bgr8", 0.0, ""))
    assert (told.width, told.height) == (3, 2) and (pictures.pixels(told)[..., 2] == 200).all()
    z = np.array([[1.0, np.nan], [2.0, 3.0]], np.float32)
    told = convert("/map/depth", conversions.array_to_image(z, "32FC1", 0.0, ""))
    assert np.array_equal(pictures.pixels(told), z, equal_nan=True)
    for topic in ("/map/reference", "/map/depth"):
        with pytest.raises(GeometryError, match="13UC5"):
            convert(topic, Image(height=1, width=2, step=2, encoding="13UC5", data=b"\0\0"))
    with pytest.raises(GeometryError):
        convert("/map/depth", Image(height=9, width=2, step=8, encoding="32FC1", data=b"\0\0"))
    tag = TagDetection(id=3, corners_px=[float(x) for four in CORNERS for x in four])
    tags = messages.OF_VEHICLE["tags/detections"][1]
    assert tags("uav2", TagDetections(detections=[tag])).corners_px == (CORNERS,)
    tag.corners_px = [math.nan] * 8
    with pytest.raises(GeometryError, match="not finite"):
        tags("uav2", TagDetections(detections=[tag]))


# ---- the window ----------------------------------------------------------------------------------


@pytest.fixture
def window(app, opened):
    c = samples.console(OUTDOOR)
    samples.flying(c)
    made = opened(c)
    made.console = c
    made.show()
    app.processEvents()
    return made


def colour(box, u, v):
    """Of the box as drawn, at a pixel of its picture."""
    shown = box.grab().toImage()
    scale = min(box.width() / box.image.width(), (box.height() - 20.0) / box.image.height())
    left = (box.width() - scale * box.image.width()) / 2.0
    top = (box.height() - 20.0 - scale * box.image.height()) / 2.0
    c = shown.pixelColor(int(left + (u + 0.5) * scale), int(top + (v + 0.5) * scale))
    return c.red(), c.green(), c.blue()


def test_pictures_are_shown_by_their_button_with_tags_outlined(window, app):
    assert not window.pictures.isVisible()
    window.show_pictures.click()
    app.processEvents()
    boxes = window.pictures.boxes
    assert boxes["uav2"].words.startswith("uav2: 1.0 Hz") and boxes["uav2"].words.endswith("tag 1")
    assert boxes["uav2"].image.width() == 640 and window.pictures.map.image.width() == 640
    u, v = CORNERS[0][0], (CORNERS[0][1] + CORNERS[3][1]) / 2.0
    r, g, b = colour(boxes["uav2"], u, v)
    assert r > 150 and g > 140 and b < 140, "the outline is yellow on the tag's edge"
    r, g, b = colour(window.pictures.map, 600, 470)
    assert r > b + 40, "the near ground is yellow"
    window.show_pictures.click()
    assert not window.pictures.isVisible()


def test_octets_that_are_no_picture_and_a_wrong_encoding_are_told_in_words(window, app):
    window.show_pictures.click()
    now_s = samples.NOW_S
    window.console.tell(now_s, facts.PreviewReport("uav1", now_s, b"\xff\xd8 not a picture"))
    window.console.tell(
        now_s, facts.Unusable("uav2", CAMERA, "encoding 'h265' with 2 octets is no picture")
    )
    window.show_view(window.console.view(now_s))
    app.processEvents()
    boxes = window.pictures.boxes
    assert (
        boxes["uav1"].words == "uav1: 16 octets that cannot be unpacked"
        and boxes["uav1"].image.isNull()
    )
    assert boxes["uav2"].words == "uav2: encoding 'h265' with 2 octets is no picture"
    assert boxes["uav2"].accessibleDescription() == boxes["uav2"].words
    window.console.tell(now_s, facts.PreviewReport("uav1", now_s, jpeg(90)))
    window.show_view(window.console.view(now_s))
    assert boxes["uav1"].image.width() == 640


def test_space_stops_all_from_a_dock_that_was_taken_out(window, app):

    from python_qt_binding.QtCore import Qt
    from python_qt_binding.QtTest import QTest

    asked = []
    window.asked.connect(lambda name, given: asked.append(name))
    app.installEventFilter(window.keys)
    window.show_pictures.click()
    window.pictures.setFloating(True)
    window.pictures.activateWindow()
    box = window.pictures.map
    box.setFocusPolicy(Qt.StrongFocus)
    box.setFocus()
    app.processEvents()
    assert box.window() is window.pictures
    QTest.keyPress(app.focusWidget() or box, Qt.Key_Space)
    until(lambda: app.processEvents() or asked, what="the key was held long enough")
    QTest.keyRelease(app.focusWidget() or box, Qt.Key_Space)
    assert asked == ["stop_all"]


def test_hidden_pictures_are_not_unpacked(window):
    window.console.tell(samples.NOW_S, facts.PreviewReport("uav1", samples.NOW_S, jpeg(90)))
    window.show_view(window.console.view(samples.NOW_S))
    assert window.pictures.boxes["uav1"].image.isNull()
