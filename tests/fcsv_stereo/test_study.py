# SPDX-License-Identifier: Apache-2.0
"""make study: a section on rendered pictures, and the clock of a flight from its bag."""

import re
import subprocess
import sys

import numpy as np
import pytest
import rosbag
import rospy
from nav_msgs.msg import Odometry

from fcsv_msgs.msg import Capture, MissionState


def study(root, *arguments):
    command = [sys.executable, str(root / "tools/study"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=root)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_errors_on_a_house_stay_below_equation_2_12(root, tmp_path):
    """Thesis figure 3.6, "mostly below": 1, 2, 3 m, whole-pixel disparities; table and picture come
    out."""
    done = study(
        root, "--only", "house", "--out", tmp_path / "study.md", "--pictures", tmp_path / "p"
    )
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "study.md").read_text()
    rows = re.findall(r"^\| (\d) m \| thesis \| ([\d.]+)% \| ([\d.]+)% \|", text, re.M)
    assert [b for b, _, _ in rows] == ["1", "2", "3"]
    assert all(float(answered) > 90 and float(below) > 80 for _, answered, below in rows), rows
    assert "(p/3_6_error.png)" in text and (tmp_path / "p/3_6_error.png").stat().st_size > 5000


_SKY = """
import sys
sys.path.insert(0, sys.argv[1])
import methods, numpy as np
from scenes import Shot, city
for b, tilt_deg in ((8.0, 0.0), (2.0, 2.0), (8.0, 8.0)):
    given, truth = city().given([Shot("horizontal", b, np.radians(tilt_deg))])
    print(np.isfinite(methods.run("joint", given, None).depth[~np.isfinite(truth)]).mean())
"""


@pytest.mark.slow
def test_the_sky_of_tilted_pairs_is_not_answered(root):
    """Figure 3.14. At 8 m and 8 degrees 84 px of the reference's sky lie outside the other picture:
    before that was looked at, 12 % of the sky were answered. What is left lies along the
    skyline."""
    command = [sys.executable, "-c", _SKY, str(root / "tools/study")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=root)
    answered = [float(word) for word in done.stdout.split()]
    assert len(answered) == 3 and max(answered) < 0.04, (answered, done.stderr)


def flown(folder):
    """A control bag: the list begins at 100 s, uav2 flies 2 m and 4 m at 1 m/s, the last recording
    ends at 130 s."""
    (folder / "session").mkdir(parents=True)
    with rosbag.Bag(str(folder / "session/control.bag"), "w") as bag:
        for t, phase in ((90.0, 6), (100.0, 7), (110.0, 7), (140.0, 8)):
            bag.write("/mission/state", MissionState(phase=phase), rospy.Time(t))
        for t in np.arange(80.0, 150.0, 0.05):
            y = float(
                np.clip(t - 102.0, 0, 2) + np.clip(t - 115.0, 0, 4) + np.clip(t - 135.0, 0, 50)
            )
            for vehicle, place in (("uav1", 0.0), ("uav2", -y)):
                message = Odometry()
                message.header.stamp = rospy.Time(t)
                message.pose.pose.position.y = place
                bag.write(f"/{vehicle}/odometry/state", message, rospy.Time(t + 0.02))
        for stop in (112.0, 130.0):
            capture = Capture(
                reference="uav1", vehicle="uav2", start=rospy.Time(stop - 3), stop=rospy.Time(stop)
            )
            bag.write("/mission/capture", capture, rospy.Time(stop))
    return folder


def test_the_clock_of_a_flight_is_read_from_its_bag(root, tmp_path):
    code = "import sys, pathlib; sys.path.insert(0, sys.argv[1]); import headline; "
    code += "print(*headline._flight(pathlib.Path(sys.argv[2])))"
    command = [
        sys.executable,
        "-c",
        code,
        str(root / "tools/study"),
        str(flown(tmp_path) / "session"),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    seconds, moved = map(float, done.stdout.split())
    assert seconds == pytest.approx(30.0) and moved == pytest.approx(6.0, abs=0.05), done.stderr


def test_a_folder_that_is_no_demo_is_named_before_anything_runs(root, tmp_path):
    (tmp_path / "map").mkdir()
    for folder in (tmp_path, tmp_path / "none"):
        done = study(
            root,
            "--only",
            "house",
            "--demo",
            folder,
            "--out",
            tmp_path / "s.md",
            "--pictures",
            tmp_path / "p",
        )
        assert done.returncode == 2 and str(folder) in done.stderr and "make demo" in done.stderr
        assert not (tmp_path / "s.md").exists()
