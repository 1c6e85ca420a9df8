# SPDX-License-Identifier: Apache-2.0
"""Ranges, errors and overlap by the reference's own camera_info, and words that say where none was
heard."""

import math

import pytest

from fcsv_console.model import facts, mission_file, samples
from fcsv_console.model.console import Console
from fcsv_console.model.planning import Wanted
from fcsv_stereo.equations import ErrorThreshold, depth_error, farthest

TEXT = """name: a
configurations:
  - {axis: horizontal, baseline_m: 4.0}
  - {axis: vertical, baseline_m: 5.0}
"""
OWN = facts.CameraKnown("uav1", 1280, 720, 900.0, 910.0)
OTHER = facts.CameraKnown("uav2", 320, 240, 250.0, 250.0)


def console(text=TEXT):
    c = Console(("uav1", "uav2"))
    c.edit(text)
    return c


def far_m(baseline_m, focal_px):
    return farthest(baseline_m, focal_px, ErrorThreshold(0.1, True))


def test_until_camera_info_is_heard_the_usual_camera_counts_and_it_is_said():
    c = console()
    assert c.file.rows[0].farthest_m == pytest.approx(far_m(4.0, 602.0))
    assert (
        c.view(1.0).optics.words == "the usual camera (640x480, f 602 px): no camera_info is heard"
    )


def test_the_references_own_camera_counts_once_it_is_heard():
    """Along the rows for a horizontal baseline, across them for a vertical one."""
    c = console()
    c.tell(1.0, OWN)
    across, up = c.file.rows
    assert across.farthest_m == pytest.approx(far_m(4.0, 900.0)) and up.farthest_m == pytest.approx(
        far_m(5.0, 910.0)
    )
    assert across.error_m == pytest.approx(depth_error(across.farthest_m, 4.0, 900.0))
    nearest_m = (4.0 * 900.0 / 1280.0, 5.0 * 910.0 / 720.0)
    assert (across.nearest_m, up.nearest_m) == pytest.approx(nearest_m)
    assert c.view(1.0).optics.words == "uav1's own camera (1280x720, f 900 px)"
    assert c.view(1.0).optics.fov_rad("horizontal") == pytest.approx(2.0 * math.atan(640.0 / 900.0))


def test_another_vehicles_camera_changes_nothing_until_it_is_the_reference():
    c = console()
    c.tell(1.0, OTHER)
    assert c.optics == mission_file.USUAL
    c.edit("reference: uav2\n" + TEXT)
    assert c.optics.heard_of == "uav2" and c.file.rows[0].farthest_m == pytest.approx(
        far_m(4.0, 250.0)
    )
    c.edit(TEXT)
    assert c.optics == mission_file.USUAL and c.file.rows[0].farthest_m == pytest.approx(
        far_m(4.0, 602.0)
    )


def test_files_and_goals_that_come_later_are_of_the_own_camera(tmp_path):
    c = Console(("uav1", "uav2"))
    c.tell(1.0, OWN)
    (tmp_path / "a.yaml").write_text(TEXT)
    c.load(tmp_path / "a.yaml")
    assert c.file.rows[0].farthest_m == pytest.approx(far_m(4.0, 900.0))
    assert not c.drag(0, 6.0) and c.file.rows[0].farthest_m == pytest.approx(far_m(6.0, 900.0))
    assert c.file.source.endswith("a.yaml")


def test_a_camera_that_is_told_again_reads_nothing_anew():
    c = console()
    c.tell(1.0, OWN)
    before = c.file
    c.tell(2.0, OWN)
    assert c.file is before
    c.tell(3.0, facts.CameraKnown("uav1", 1280, 720, 950.0, 950.0))  # another resolution, or a zoom
    assert c.file.rows[0].farthest_m == pytest.approx(far_m(4.0, 950.0))


def test_a_file_that_cannot_be_flown_stays_named_as_such():
    c = console(TEXT.replace("4.0", "-4.0"))
    c.tell(1.0, OWN)
    assert c.file.error is not None and c.optics.heard_of == "uav1"
    c.edit(TEXT)
    assert c.file.rows[0].farthest_m == pytest.approx(far_m(4.0, 900.0))


def test_plans_are_made_for_the_own_camera_and_say_so():
    """A baseline for 10 % at 400 m by equation 3.1: twice the focal length takes half of it."""
    c, found = console(), []
    for focal_px in (450.0, 900.0):
        c.tell(1.0, facts.CameraKnown("uav1", 1280, 720, focal_px, focal_px))
        found.append(c.plan(Wanted(400.0, "10%", 1, whole=False)))
        assert f"for uav1's own camera (1280x720, f {focal_px:.0f} px)" in found[-1].notes
    baselines = [mission_file.parse(p.text).mission.configurations[0].baseline_m for p in found]
    assert baselines[0] == pytest.approx(2.0 * baselines[1], rel=0.01)
    assert any(
        "no camera_info is heard" in n for n in console().plan(Wanted(400.0, "10%", 1)).notes
    )


def test_the_error_of_the_pair_that_is_flown_is_of_the_own_camera():
    c = samples.console("")
    c.edit(TEXT + "  - {axis: vertical, baseline_m: 8.0}\n")
    samples.SAMPLES["flying"](c)
    c.tell(samples.NOW_S, OWN)
    health = c.view(samples.NOW_S).stereo
    row = c.file.rows[c.view(samples.NOW_S).running]
    f_px = 900.0 if row.axis == "horizontal" else 910.0
    assert health.error_m == pytest.approx(depth_error(health.target_m, health.baseline_m, f_px))


@pytest.mark.parametrize(
    "fact, words",
    [
        (facts.CameraKnown("uav1", 1280, 720, math.nan, 900.0), "focal_px holds nan"),
        (facts.CameraKnown("uav9", 1280, 720, 900.0, 900.0), "uav9"),
    ],
)
def test_a_camera_that_is_none_changes_nothing(fact, words):
    c = console()
    c.tell(1.0, fact)
    assert c.optics == mission_file.USUAL and any(words in p for p in c.view(1.0).problems)


def test_the_window_says_whose_camera_it_computes_with(opened):
    c = console()
    window = opened(c)
    window.show_view(c.view(1.0))
    line = window.mission.optics
    assert line.text() == f"Ranges and errors: {mission_file.USUAL.words}" and not line.isHidden()
    c.tell(1.0, OWN)
    window.show_view(c.view(1.1))
    assert line.isHidden() and window.mission.table.toolTip() == line.text()
    assert line.text() == "Ranges and errors: uav1's own camera (1280x720, f 900 px)"
    assert window.plan._fov_rad == pytest.approx(2.0 * math.atan(640.0 / 900.0))
