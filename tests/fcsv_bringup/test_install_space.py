# SPDX-License-Identifier: Apache-2.0
"""`cmake --install`: a vehicle starts from the install space alone; packages declare what they
import."""

import ast
import os
import re
import subprocess

import psutil
import pytest
from support.waiting import within

from fcsv_sim.machines.machines import Machine, free_port

pytestmark = [pytest.mark.ros, pytest.mark.slow]

until = within(usual_s=90.0)
NAMES = ("console", "control", "geometry", "guidance", "multimaster", "sim", "stereo", "tracking")
PACKAGES = [f"fcsv_{name}" for name in NAMES]
#: rosdep's keys of what comes as a Debian package; all else that is no ROS package stands in
#: requirements.txt
KEYS = {"rospkg": "python3-rospkg", "yaml": "python3-yaml", "cryptography": "python3-cryptography"}
ROS_PACKAGES = {
    "actionlib",
    "cv_bridge",
    "diagnostic_updater",
    "genpy",
    "interactive_markers",
    "message_filters",
    "python_qt_binding",
    "rosbag",
    "rosgraph",
    "roslib",
    "rospy",
    "rviz",
    "tf2_geometry_msgs",
    "tf2_ros",
}
#: Whose driver a vehicle has decides its owner; roslaunch names what is missing.
OPTIONAL = {"mavros", "realsense2_camera", "usb_cam"}


@pytest.fixture(scope="module")
def install_space(root, tmp_path_factory):
    """The workspace installed below a temporary folder; skipped where it was not configured by
    setup."""
    stage = tmp_path_factory.mktemp("stage")
    command = ["cmake", "--install", str(root / "build")]
    done = subprocess.run(
        command, env=dict(os.environ, DESTDIR=str(stage)), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-2000:]
    return next(stage.rglob("_setup_util.py")).parent


@pytest.fixture
def sourced(install_space, monkeypatch):
    """This process's environment is that of a shell that read the install space's setup.bash and
    nothing else."""
    shell = [
        "env",
        "-i",
        f"HOME={os.environ.get('HOME', '/')}",
        "PATH=/usr/bin:/bin",
        "bash",
        "-c",
        f". {install_space}/setup.bash && exec env -0",
    ]
    text = subprocess.run(shell, check=True, capture_output=True, text=True).stdout
    for name in list(os.environ):
        if name.startswith("ROS") or name in ("CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH"):
            monkeypatch.delenv(name)
    for name, _, value in (line.partition("=") for line in text.split("\0") if line):
        monkeypatch.setenv(name, value)


def test_a_vehicle_starts_from_the_install_space(root, install_space, sourced, tmp_path):
    port = free_port()
    with Machine("uav1", tmp_path) as machine:
        machine.launch(
            "fcsv_bringup",
            "uav.launch",
            uav="uav1",
            sim=True,
            sim_dir=tmp_path / "sim",
            record_dir=tmp_path / "session",
            listen=f"127.0.0.1:{free_port()}/{free_port()}",
            fcu_url=f"udpin:127.0.0.1:{port}",
            sim_mavlink_port=port,
            sim_rc_port=free_port(),
            sim_ready_s=2.0,
        )
        heard = {}
        for topic in ("guardian/state", "mavros/local_position/pose", "recorder/status"):
            command = ["rostopic", "echo", "-n1", "--noarr", f"/uav1/{topic}"]
            heard[topic] = machine.run(command, "heard-" + topic.replace("/", "-"))
        until(
            lambda: all(p.returncode is not None for p in heard.values()),
            what="guardian, position and recorder",
        )
        assert {t: p.returncode for t, p in heard.items()} == dict.fromkeys(heard, 0), heard[
            "guardian/state"
        ].tail()
        nodes = list(_nodes_of(machine))
        assert len(nodes) > 8
        places = (str(root / "src"), str(root / "devel"))
        assert not [c for c in nodes if any(place in word for word in c for place in places)]
        assert all(str(install_space) in " ".join(c) for c in nodes)


def _nodes_of(machine):
    """The command of each process that is a node of this machine's vehicle."""
    for process in psutil.process_iter(["environ", "cmdline"]):
        command, environment = process.info["cmdline"] or [], process.info["environ"] or {}
        if environment.get("ROS_MASTER_URI") == machine.master_uri and any(
            c.startswith("__name:=") for c in command
        ):
            if not any(c.startswith("__name:=rosout") for c in command):
                yield command


def test_every_module_and_file_of_a_package_is_installed(root, install_space):
    libraries = next(install_space.rglob("dist-packages"), None) or next(
        install_space.rglob("site-packages")
    )
    for package in PACKAGES:
        source = root / "src" / package / "src" / package
        wanted = {
            p.relative_to(source)
            for p in source.rglob("*")
            if p.is_file() and "__pycache__" not in p.parts
        }
        assert wanted and not [p for p in wanted if not (libraries / package / p).is_file()], (
            package
        )
    assert (libraries / "fcsv_geometry/bags/definitions/Calibration.msg").is_file()
    share = install_space / "share/fcsv_bringup"
    for folder in ("launch", "rviz", "config"):
        wanted = {p.relative_to(root) for p in (root / folder).rglob("*") if p.is_file()}
        assert wanted and not [p for p in wanted if not (share / p).is_file()]
    assert os.access(share / "scripts/priority", os.X_OK)
    assert (install_space / "lib/libfcsv_slow_motion.so").is_file()


def test_executables_run_the_configured_interpreter(root, install_space):
    """On Debian catkin leaves `env python3`, which lacks what requirements.txt pins."""
    cache = (root / "build/CMakeCache.txt").read_text()
    python = re.search(r"^PYTHON_EXECUTABLE:\w+=(.*)$", cache, re.M).group(1)
    found = [p for package in PACKAGES for p in (install_space / "lib" / package).glob("*")]
    assert len(found) == len(list(root.glob("src/fcsv_*/nodes/*")))
    assert {p.read_text().splitlines()[0] for p in found} == {f"#!{python}"}
    assert all(os.access(p, os.X_OK) for p in found)


def declared(root, package):
    """What a package.xml declares, of any kind."""
    return set(
        re.findall(
            r"<(?:\w+_)?depend>([\w-]+)<", (root / "src" / package / "package.xml").read_text()
        )
    )


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_declares_what_it_imports(root, package):
    base, imported = root / "src" / package, set()
    for path in [*base.glob("src/**/*.py"), *(p for p in base.glob("nodes/*") if p.is_file())]:
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += (
                [node.module]
                if isinstance(node, ast.ImportFrom) and node.module and not node.level
                else []
            )
            imported |= {name.split(".")[0] for name in names}
    needed = {
        KEYS.get(m, m)
        for m in imported - {package}
        if m in KEYS or m in ROS_PACKAGES or m.startswith("fcsv_") or m.endswith(("_msgs", "_srvs"))
    }
    build = {"catkin", "fcsv_geometry"}  # fcsv_install_nodes() is fcsv_geometry's
    assert needed | build - {package} == declared(root, package) | build - {package}


def test_bringup_declares_the_packages_of_its_launch_files(root):
    text = "".join(p.read_text() for p in (root / "launch").rglob("*.launch"))
    started = set(re.findall(r'pkg="(\w+)"', text)) | set(re.findall(r"\$\(find (\w+)\)", text))
    assert started - OPTIONAL - {"fcsv_bringup"} <= declared(root, "fcsv_bringup")


def test_all_packages_have_one_version(root):
    versions = {
        p.parent.name: re.search(r"<version>(.*)<", p.read_text()).group(1)
        for p in root.glob("src/fcsv_*/package.xml")
    }
    project = re.search(r'^version = "(.*)"', (root / "pyproject.toml").read_text(), re.M).group(1)
    assert set(versions.values()) == {project}, versions
