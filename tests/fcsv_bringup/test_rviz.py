# SPDX-License-Identifier: Apache-2.0
"""rviz's configurations: what they show exists, and rviz opens them without a warning before home
is set."""

import math
import re
import time

import pytest
import yaml
from support.waiting import within

CONFIGURATIONS = ("map", "tracking")
_BARS_PX = 90  # menus, tools and status
until = within(60.0)
#: What rviz itself says of packages with plugins that are not installed here.
FOREIGN = ("media_export", "librospack", "XDG_RUNTIME_DIR")


def displays(root, name):
    def flat(found):
        for display in found:
            yield display
            yield from flat(display.get("Displays", []))

    manager = yaml.safe_load((root / "rviz" / f"{name}.rviz").read_text())["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "home"
    return list(flat(manager["Displays"]))


@pytest.mark.parametrize("name", [*CONFIGURATIONS, "monitor"])
def test_every_topic_is_one_of_the_page_and_no_vehicle_is_named_that_may_not_fly(name, root):
    page = (root / "docs/design/architecture.md").read_text()
    topics = [
        d[k]
        for d in displays(root, name)
        for k in ("Topic", "Marker Topic", "Image Topic")
        if k in d
    ]
    for topic in topics:
        listed = re.sub(r"^/map/baselines/.*", "/map/baselines/*", re.sub(r"^/uav\d/", "", topic))
        assert f"`{listed}`" in page, topic
    of_vehicles = {t for t in topics if re.match(r"/(uav|tello)\d", t)}
    cameras = {"/uav1/camera/color/image_raw", "/uav2/camera/color/image_raw"}
    assert of_vehicles == (cameras if name == "map" else set()) and "/tracking/vehicles" in topics


@pytest.mark.parametrize("name", [*CONFIGURATIONS, "monitor"])
def test_labels_are_read_on_a_screen_of_1366_pixels(name, root):
    """From where each view begins, in rviz's field of 45 degrees: letters of 12 px and more for
    what stands at home."""
    from fcsv_console.ros import goal_markers
    from fcsv_tracking.ros import mission_markers, vehicle_markers

    document = yaml.safe_load((root / "rviz" / f"{name}.rviz").read_text())
    window, view = (
        document["Window Geometry"],
        document["Visualization Manager"]["Views"]["Current"],
    )
    assert (window["Width"], window["Displays"]["collapsed"]) == (1366, True) and window[
        "Height"
    ] <= 768
    along_m = view["Distance"] * math.cos(view["Pitch"]) - view["Focal Point"]["X"]
    up_m = view["Distance"] * math.sin(view["Pitch"]) + view["Focal Point"]["Z"]
    px_per_m = (window["Height"] - _BARS_PX) / (
        2.0 * math.hypot(along_m, up_m) * math.tan(math.radians(22.5))
    )
    letters_m = (vehicle_markers.NAME_M, mission_markers.TEXT_M, goal_markers.WORDS_M)
    assert min(letters_m) * px_per_m >= 11.5, [round(m * px_per_m, 1) for m in letters_m]


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.xdist_group("rviz")
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_it_opens_without_a_warning_before_anything_is_known(
    name, root, ros_master, start_node, tmp_path
):
    """On a screen of its own; the displays that are on find their fixed frame."""
    start_node(
        "fcsv_tracking",
        "markers",
        params={"vehicles": ["uav1", "uav2"], "vehicles_dir": str(root / "config" / "vehicles")},
    )
    screen = ros_master.run(
        ["Xvfb", "-displayfd", "1", "-screen", "0", "1280x800x24"], f"screen-{name}"
    )
    rviz = None
    try:
        until(lambda: re.search(r"^\d+$", screen.tail(20), re.M), what="a screen")
        number = re.search(r"^(\d+)$", screen.tail(20), re.M).group(1)
        settings = [
            f"DISPLAY=:{number}",
            "QT_QPA_PLATFORM=xcb",
            "LIBGL_ALWAYS_SOFTWARE=1",
            "ROSCONSOLE_STDOUT_LINE_BUFFERED=1",
            f"HOME={tmp_path}",
            f"XDG_RUNTIME_DIR={tmp_path}",
        ]
        command = [
            "env",
            *settings,
            "rviz",
            "-d",
            str(root / "rviz" / f"{name}.rviz"),
            f"__name:=rviz_{name}",
        ]
        rviz = ros_master.run(command, f"rviz-{name}")
        try:
            until(lambda: "OpenGl version" in rviz.tail(100) or "Stereo is" in rviz.tail(100))
        except AssertionError:
            pytest.fail(
                f"rviz did not open; it said: {rviz.tail(30)}\nits screen: {screen.tail(5)}"
            )
        time.sleep(3.0)
        said = [s for s in rviz.tail(100).splitlines() if re.search("warn|error", s, re.I)]
        assert rviz.returncode is None and not [s for s in said if not any(f in s for f in FOREIGN)]
    finally:
        for process in (rviz, screen):
            if process is not None:
                process.stop(grace_s=5.0)
