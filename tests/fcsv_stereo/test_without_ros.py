# SPDX-License-Identifier: Apache-2.0
"""The wheel in an environment that knows no ROS maps photographs and sessions to the depth of the
catkin way."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.gps_tags import flown_photographs
from support.photographs import model
from support.ros2_bags import session_to_ros2
from support.scenes import CAMERA, camera_pose, photograph
from support.sessions import write_session

from fcsv_stereo import cli, fcsv_command
from fcsv_stereo.posed import colmap

# the one whose wheels requirements.txt has brought into pip's cache
SYSTEM_PYTHON = Path("/usr/bin/python3")
ROS = (
    "rospy",
    "rosbag",
    "genpy",
    "cv_bridge",
    "tf2_ros",
    "sensor_msgs",
    "fcsv_msgs",
    "rospkg",
    "catkin_pkg",
)
# maps as the command does, where nothing of ROS can be imported
BLOCKED = f"""
import sys

class Block:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {ROS!r}:
            raise ImportError(name + " is of ROS")

sys.meta_path.insert(0, Block())
from fcsv_stereo.fcsv_command import main
sys.exit(main(sys.argv[1:]))
"""


def photographs(folder):
    """Two photographs side by side in COLMAP's text model, whose world is the first camera."""
    c = CAMERA
    model(
        folder,
        f"1 PINHOLE {c.width} {c.height} {c.fx} {c.fy} {c.cx + 0.5} {c.cy + 0.5}\n",
        "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 -0.8 0 0 1 b.png\n\n",
    )
    for name, y in (("a", 0.0), ("b", -0.8)):
        rgb = photograph(camera_pose([0.0, y, 0.0]))
        cv2.imwrite(str(folder / "images" / f"{name}.png"), cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    return folder


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Folder with a session of ROS 1, the same of ROS 2, photographs, and some with GPS tags and
    COLMAP's model."""
    folder = tmp_path_factory.mktemp("inputs")
    write_session(folder / "session")
    session_to_ros2(folder / "session", folder / "ros2", "mcap")
    photographs(folder / "photographs")
    flown_photographs(folder / "flown")
    return folder


def without(folder):
    """An environment variables' table in which neither ROS nor this checkout is."""
    kept = (
        "HOME",
        "LANG",
        "TMPDIR",
        "http_proxy",
        "https_proxy",
        "HTTP_PROXY",
        "HTTPS_PROXY",
        "SSL_CERT_FILE",
    )
    # kernels and threads: another choice rounds otherwise
    numeric = ("OPENBLAS_", "OMP_", "NUMBA_")
    kept += tuple(name for name in os.environ if name.startswith(("PIP_", *numeric)))
    return {
        **{k: os.environ[k] for k in kept if k in os.environ},
        "PATH": f"{folder}/bin:/usr/bin:/bin",
    }


def run(command, timeout_s=250, **more):
    return subprocess.run(
        [*map(str, command)], capture_output=True, text=True, timeout=timeout_s, **more
    )


def test_the_command_names_what_it_knows(capsys):
    assert fcsv_command.main(["fly"]) == 2
    assert "no command 'fly'; there are map, survey, plan" in capsys.readouterr().err
    assert fcsv_command.main(["--help"]) == fcsv_command.main([]) == 0
    said = capsys.readouterr().out
    assert all(f"\n  {name} " in said for name in fcsv_command.COMMANDS)
    assert fcsv_command.main(["plan", "--range-m", "-1"]) == 2
    assert capsys.readouterr().err.startswith("plan: ")


@pytest.mark.parametrize("name", ["session", "ros2", "photographs"])
def test_map_imports_nothing_of_ros(inputs, tmp_path, name):
    done = run(
        [
            sys.executable,
            "-c",
            BLOCKED,
            "map",
            inputs / name,
            "-o",
            tmp_path / "map",
            "--method",
            "thesis",
        ]
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert np.isfinite(np.load(tmp_path / "map" / "depth.npy")).any()


def give_kernels(root, environment):
    """The joint method's compiled kernels for a wheel whose sources are, byte by byte, those of the
    checkout: compiled again they would be the same, a minute later. numba goes by a source's time
    and size. The other kernels are compiled there."""
    (packages,) = environment.glob("lib/python3*/site-packages")
    for source in sorted((root / "src/fcsv_stereo/src/fcsv_stereo/joint").rglob("*.py")):
        installed = packages / source.relative_to(root / "src/fcsv_stereo/src")
        assert installed.read_bytes() == source.read_bytes()
        times = source.stat()
        (installed.parent / "__pycache__").mkdir(exist_ok=True)
        os.utime(installed, ns=(times.st_atime_ns, times.st_mtime_ns))
        for kernel in (source.parent / "__pycache__").glob(f"{source.stem}.*.nb[ic]"):
            shutil.copy(kernel, installed.parent / "__pycache__")


@pytest.fixture(scope="module")
def clean(root, tmp_path_factory):
    """A new environment with the wheel in it, of the versions in requirements.txt; skipped without
    a package index."""
    folder = tmp_path_factory.mktemp("clean")
    env = without(folder / "venv")
    made = run([SYSTEM_PYTHON, "-m", "venv", folder / "venv"], env=env)
    assert made.returncode == 0, made.stderr
    pip = [folder / "venv/bin/pip", "-q", "--disable-pip-version-check"]
    there = run(
        [
            *pip,
            "--retries",
            "1",
            "download",
            "--no-deps",
            "--no-cache-dir",
            "-d",
            folder,
            "hatchling",
        ],
        env=env,
    )
    if there.returncode:
        pytest.skip(f"no package index can be reached: {there.stderr.strip().splitlines()[-1]}")
    # what is imported is compiled then
    wheel = [*pip, "install", "--no-compile", "-c", root / "requirements.txt", root]
    done = run(wheel, env=env)
    assert done.returncode == 0, done.stderr[-2000:]
    give_kernels(root, folder / "venv")
    return folder / "venv", env


@pytest.mark.slow
@pytest.mark.timeout(900)  # two maps: long on a busy machine
def test_the_wheel_maps_as_the_catkin_way_does(inputs, clean, tmp_path):
    """The same versions, kernels and threads on the same machine: the same depth to the last
    bit."""
    venv, env = clean
    assert run([venv / "bin/python", "-c", "import rospy"], env=env).returncode == 1
    assert run([venv / "bin/python", "-c", "import fcsv_stereo.ros"], env=env).returncode == 1
    for name, options in (("photographs", []), ("session", []), ("ros2", ["--method", "thesis"])):
        arguments = ["map", inputs / name, *options, "-o"]
        done = run(
            [venv / "bin/fcsv", *arguments, tmp_path / f"{name}-wheel"], env=env, cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr[-2000:]
        assert cli.main([*map(str, arguments[1:]), str(tmp_path / f"{name}-catkin")]) == 0
        for file in ("depth.npy", "sigma.npy", "kind.npy"):
            found, expected = (
                np.load(tmp_path / f"{name}-{way}" / file) for way in ("wheel", "catkin")
            )
            assert np.array_equal(found, expected, equal_nan=file != "kind.npy"), f"{name}: {file}"
        assert np.isfinite(np.load(tmp_path / f"{name}-wheel" / "depth.npy")).mean() > 0.5
        assert (tmp_path / f"{name}-wheel" / "report.html").stat().st_size > 10000
    plan = run(
        [venv / "bin/fcsv", "plan", "--range-m", "400", "--error", "10%"], env=env, cwd=tmp_path
    )
    assert plan.returncode == 0 and "300 to 400 m" in plan.stdout
    flown, out = inputs / "flown", tmp_path / "imported"
    imported = [
        venv / "bin/fcsv",
        "import-photos",
        flown / "photos",
        "-o",
        out,
        "--model",
        flown / "model",
    ]
    done = run(imported, env=env, cwd=tmp_path)
    assert done.returncode == 0 and "images/ (5)" in done.stdout, done.stderr[-2000:]
    given = colmap.read_photographs(out, "2.jpg")
    assert (
        len(given.configurations) == 4 and given.configurations[0].others[0].covariance is not None
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "content, words",
    [
        (b"#ROSBAG V1.2\n" + bytes(500), "is a bag of version 1.2, only 2.0 is read"),
        (b"#ROSBAG V2.0\n" + bytes(500), "holds no whole message"),
        (b"no bag", "is not a bag"),
    ],
    ids=["version", "empty", "text"],
)
def test_the_wheel_names_a_bad_bag_in_one_line(clean, tmp_path, content, words):
    venv, env = clean
    (tmp_path / "a.bag").write_bytes(content)
    done = run([venv / "bin/fcsv", "map", "a.bag", "-o", "map"], env=env, cwd=tmp_path)
    assert (
        done.returncode == 2 and done.stderr.startswith("map: a.bag: ") and words in done.stderr
    ), done.stderr
    assert done.stderr.count("\n") == 1 and not (tmp_path / "map").exists()
