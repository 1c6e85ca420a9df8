# SPDX-License-Identifier: Apache-2.0
"""The planner against the thesis's own examples, against rays, and against the loader of
fcsv_control."""

import doctest
import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.camera_file import write_camera
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.mission import load_mission
from fcsv_stereo import equations
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.errors import PlanError
from fcsv_stereo.planning import command, overlap
from fcsv_stereo.planning import plan as plan_module
from fcsv_stereo.planning.mission import mission_document, write_mission
from fcsv_stereo.planning.plan import PlanRequest, make_plan

CAMERA = PinholeCamera(640, 480, 602.0, 602.0, 319.5, 239.5)
TEN_PERCENT = ErrorThreshold(0.1, True)


def request(range_m=400.0, threshold=TEN_PERCENT, **more):
    return PlanRequest(range_m, threshold, CAMERA, **more)


@pytest.mark.parametrize("module", [equations, overlap, plan_module])
def test_numbers_in_the_docstrings(module):
    result = doctest.testmod(module, extraglobs={"np": np})
    assert result.attempted and not result.failed


def test_the_list_of_the_simulated_city():
    """3.2: 10 %, 602 px, 1 px: 2, 4, 6, 8 m are trimmed at 120, 240, 360, 480 m."""
    plan = make_plan(request(480.0, baselines_m=[2, 4, 6, 8]))
    assert [b.range_m for b in plan.baselines] == [(0, 120), (120, 240), (240, 360), (360, 480)]
    assert [b.farthest_m for b in plan.baselines] == pytest.approx([120.4, 240.8, 361.2, 481.6])
    same = make_plan(request(480.0, count=4, whole=True))  # and 3.2 with 3.3 find the same list
    assert [b.baseline_m for b in same.baselines] == [2, 4, 6, 8]
    assert [b.range_m for b in same.baselines] == [b.range_m for b in plan.baselines]


def test_the_example_of_figure_3_7():
    plan = make_plan(request(40.0, ErrorThreshold(0.5, False), count=3))
    assert [b.range_m[1] for b in plan.baselines] == pytest.approx([40 / 3, 80 / 3, 40])
    assert [b.baseline_m for b in plan.baselines] == pytest.approx(
        [z**2 / (0.5 * 602) for z in (40 / 3, 80 / 3, 40)]
    )
    assert [b.error_m for b in plan.baselines] == pytest.approx([0.5] * 3)


def test_trim_points_by_hand():
    """The outdoor experiment of 6.7."""
    plan = make_plan(
        request(120.0, baselines_m=[5, 7, 10], trim_m=[40, 80, 120], axes=("vertical",))
    )
    assert [b.range_m for b in plan.baselines] == [(0, 40), (40, 80), (80, 120)]
    # beyond 3.1: said, not hidden
    assert make_plan(request(300.0, baselines_m=[2], trim_m=[300])).notes


@settings(max_examples=60)
@example(191.0, 0.25, 6, 0.75, False, True)  # 12 and 13 m both end at 190 m in two digits
@example(500.0, 0.25, 8, 0.9, False, True)
@given(
    st.floats(20, 500),
    st.floats(0.02, 0.3),
    st.integers(1, 8),
    st.floats(0, 0.9),
    st.booleans(),
    st.booleans(),
)
def test_every_range_holds_the_error_and_has_no_gap(range_m, value, count, near, relative, whole):
    threshold = ErrorThreshold(value, True) if relative else ErrorThreshold(value * 20, False)
    plan = make_plan(
        request(range_m, threshold, nearest_m=near * range_m, count=count, whole=whole)
    )
    ends = [near * range_m]
    for b in plan.baselines:
        assert b.range_m[0] == pytest.approx(ends[-1]) and b.range_m[1] > b.range_m[0]
        accepted = value * b.range_m[1] if relative else value * 20
        assert b.error_m <= accepted * (1 + 1e-9)
        ends.append(b.range_m[1])
    assert ends[-1] == pytest.approx(range_m)


@settings(max_examples=60)
@given(st.floats(1, 12), st.floats(0, 12), st.floats(5, 300))
def test_overlap_is_what_rays_see(baseline_m, tilt_deg, z_m):
    """Points across the reference's view at one depth, projected into the other camera, counted."""
    fov, tilt = np.radians(56.0), np.radians(tilt_deg)
    x = (np.arange(4000) + 0.5) / 4000 * 2 - 1
    x = x * z_m * np.tan(fov / 2)
    # seen from the other camera, from its optical axis
    angle = np.arctan2(x - baseline_m, z_m) + tilt
    unseen = float((np.abs(angle) > fov / 2).mean())
    # two edges' points
    assert overlap.non_overlap(z_m, baseline_m, fov, tilt) == pytest.approx(unseen, abs=1 / 2000)
    starts = overlap.overlap_starts_m(baseline_m, fov, tilt)
    assert overlap.non_overlap(starts * 0.99, baseline_m, fov, tilt) == 1.0
    assert overlap.non_overlap(starts * 1.02, baseline_m, fov, tilt) < 1.0


def test_tilt_of_3_5_brings_the_views_together():
    plain, tilted = (
        make_plan(request(baselines_m=[8], tilt_per_m_rad=np.radians(t))).baselines[0]
        for t in (0.0, 1.0)
    )
    assert np.degrees(tilted.tilt_rad) == pytest.approx(8.0)
    assert tilted.overlap_starts_m < plain.overlap_starts_m


def test_the_mission_is_one_that_fcsv_control_flies(tmp_path):
    plan = make_plan(request(baselines_m=[2, 4, 6.5, 8], tilt_per_m_rad=np.radians(1.0)))
    write_mission(mission_document(plan, "planned: 400 m", record_s=3.0), tmp_path / "m.yaml")
    mission = load_mission(tmp_path / "m.yaml")
    assert mission.name == "planned: 400 m"
    assert [(c.axis, c.baseline_m, c.tilt_deg, c.record_s) for c in mission.configurations] == [
        ("horizontal", b, b, 3.0) for b in (2.0, 4.0, 6.5, 8.0)
    ]


@pytest.mark.parametrize(
    "more, named",
    [
        ({"baselines_m": [1.0, 4.0]}, "minimum separation"),
        ({"baselines_m": [2.0, 6.0], "axes": ("vertical",), "tilt_per_m_rad": 0.02}, "pitch"),
        ({"baselines_m": [2.0, 8.0], "tilt_per_m_rad": np.radians(4.0)}, "tilted"),
    ],
)
def test_what_the_mission_loader_refuses_is_refused_here(more, named, tmp_path):
    plan = make_plan(request(**more))
    with pytest.raises(PlanError, match=named):
        mission_document(plan, "m")
    rows = [
        {
            "axis": b.axis,
            "baseline_m": float(b.baseline_m),
            "tilt_deg": float(np.degrees(b.tilt_rad)),
        }
        for b in plan.baselines
    ]
    write_mission({"name": "m", "configurations": rows}, tmp_path / "m.yaml")
    with pytest.raises(ConfigError):
        load_mission(tmp_path / "m.yaml")


@settings(max_examples=40)
@given(
    st.lists(st.floats(0.3, 20), min_size=1, max_size=5, unique=True),
    st.floats(0, 5),
    st.floats(0.1, 700),
    st.floats(0.5, 9),
    st.sampled_from(["horizontal", "vertical"]),
)
def test_planner_and_loader_agree(
    tmp_path_factory, baselines, tilt_deg, record_s, separation, axis
):
    try:
        plan = make_plan(
            request(
                9000.0,
                baselines_m=sorted(baselines),
                axes=(axis,),
                tilt_per_m_rad=np.radians(tilt_deg),
            )
        )
        document = mission_document(plan, "m", record_s, separation)
    except PlanError:
        return
    path = tmp_path_factory.mktemp("mission") / "m.yaml"
    write_mission(document, path)
    assert len(load_mission(path).configurations) == len(baselines)


@pytest.mark.parametrize(
    "words, named",
    [
        ("--range-m 0", "--range-m"),
        ("--range-m nan", "--range-m"),
        ("--range-m 40 --nearest-m 40", "--nearest-m"),
        ("--range-m 400 --error x", "error threshold"),
        ("--range-m 400 --baselines 4 2", "--baselines"),
        ("--range-m 400 --baselines 2 4 --number 2", "not both"),
        ("--range-m 400 --baselines 2 4 --trim 100", "--trim"),
        ("--range-m 400 --focal-px -3", "focal length"),
        ("--range-m 400 --number 0", "--number"),
        ("--range-m 100 --baselines 2 8", "nothing left"),
        ("--range-m 400 --fov-deg 200", "--fov-deg"),
        ("--range-m 40 --error 0.5 --number 3 --mission {}/no.yaml", "minimum separation"),
    ],
)
def test_bad_requests_name_the_option_and_write_nothing(words, named, capsys, tmp_path):
    assert command.main(words.format(tmp_path).split()) == 2
    error = capsys.readouterr().err
    assert named in error and error.count("\n") == 1 and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "words, noted",
    [
        (
            "--range-m 400 --error 0.4%",
            "horizontal: 83, 125, 166 m would leave the fence (60 m): accept a larger --error",
        ),
        (
            "--range-m 400 --error 0.4% --axis both",
            "vertical: 42, 83, 125, 166 m would leave the fence (40 m)",
        ),
        (
            "--range-m 7 --error 10% --number 1",
            "horizontal: 0.12 m is nearer than two vehicles may fly (1.5 m)",
        ),
    ],
)
def test_baselines_that_nobody_can_fly_are_remarked(words, noted, capsys):
    assert command.main(words.split()) == 0
    assert f"note: {noted}" in capsys.readouterr().out


def test_baselines_that_can_be_flown_are_not_remarked(capsys):
    assert command.main("--range-m 400 --error 10%".split()) == 0
    assert "note:" not in capsys.readouterr().out


def test_the_command_writes_what_it_says(tmp_path, capsys):
    words = f"--range-m 400 --error 10% --baselines 2 4 6 8 --figures {tmp_path} --mission {tmp_path}/m.yaml"
    assert command.main(words.split()) == 0
    printed = capsys.readouterr().out
    assert (
        len(re.findall(r"^horizontal ", printed, re.M)) == 4
        and "--trim-horizontal 120 240 360 400" in printed
    )
    assert {p.name for p in tmp_path.iterdir()} == {"error_curves.png", "segments.png", "m.yaml"}


def test_a_plan_for_the_own_camera_is_made_from_its_calibration_file(tmp_path, capsys):
    """Equation 3.1: the focal length of the file decides, along the rows and across them."""
    own = PinholeCamera(1280, 720, 900.0, 910.0, 640.0, 360.0, (-0.2, 0.05, 0.0, 0.0, 0.0))
    write_camera(tmp_path / "own.yaml", "own", own)
    words = f"--range-m 400 --baselines 4 --axis both --camera {tmp_path}/own.yaml"
    assert command.main(words.split()) == 0
    said = capsys.readouterr().out
    for focal_px in (900.0, 910.0):
        assert f"{equations.farthest(4.0, focal_px, ErrorThreshold(0.1, True)):.1f} m" in said
    assert "no camera named" not in said
    assert command.main("--range-m 400 --baselines 4".split()) == 0
    assert "no camera named: planned for the D435's 56 degrees" in capsys.readouterr().out


@pytest.mark.parametrize(
    "more, words",
    [
        ("--fov-deg 60", "leave --focal-px, --fov-deg and --size out"),
        ("--size 640 480", "leave --focal-px"),
        ("", "fisheye"),
    ],
)
def test_a_camera_that_cannot_be_planned_for_is_named(tmp_path, capsys, more, words):
    write_camera(tmp_path / "own.yaml", "own", CAMERA)
    if not more:
        (tmp_path / "own.yaml").write_text(
            (tmp_path / "own.yaml").read_text().replace("plumb_bob", "equidistant")
        )
    assert command.main(f"--range-m 400 --camera {tmp_path}/own.yaml {more}".split()) == 2
    said = capsys.readouterr().err
    assert said.startswith("plan: ") and said.count("\n") == 1 and words in said


def test_a_list_of_its_own_leaves_out_what_is_too_short_to_be_flown(tmp_path, capsys):
    """By 3.3 alone 150 m would begin with 0.62 m; who names a number gets that number."""
    plan = f"--range-m 150 --error 10% --mission {tmp_path / 'mine.yaml'}".split()
    assert command.main(plan) == 0
    flown = load_mission(tmp_path / "mine.yaml").configurations
    assert [round(c.baseline_m, 2) for c in flown] == [1.87, 2.49]
    assert "left out, as nearer than two vehicles may fly (1.5 m): 0.62, 1.25 m" in (
        capsys.readouterr().out
    )
    assert command.main("--range-m 150 --error 10% --number 4".split()) == 0
    assert capsys.readouterr().out.count("horizontal  ") == 4
    assert command.main("--range-m 40 --error 10%".split()) == 0
    assert capsys.readouterr().out.count("horizontal  ") == 4, "none can be flown: all are shown"


def test_what_follows_a_plan_is_printed_as_whole_commands(tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    assert command.main(f"--range-m 100 --error 5% --baselines 2 3 4 --mission {path}".split()) == 0
    said = capsys.readouterr().out.splitlines()
    commands = [line.partition(": ")[2].strip() for line in said if ": " in line][-5:]
    first = ["rosrun", "make", "docs/user/flying.md,", "rosrun", "rosrun"]
    assert [c.split()[0] for c in commands] == first and commands[1].endswith("OUT=out/mine")
    assert all(str(path) in c for c in commands[:3]) and commands[2].endswith(f"mission:={path}")
