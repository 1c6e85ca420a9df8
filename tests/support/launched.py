# SPDX-License-Identifier: Apache-2.0
"""What a launch file would start, read by roslaunch itself in a process of its own; nothing is
started."""

import json
import os
import subprocess
import sys

_READ = """
import json, sys
import roslaunch.config, roslaunch.xmlloader
config = roslaunch.config.ROSLaunchConfig()
try:
    roslaunch.xmlloader.XmlLoader().load(sys.argv[1], config, argv=sys.argv[2:], verbose=False)
except Exception as error:
    print(json.dumps({"error": f"{type(error).__name__}: {error}"}))
    sys.exit()
nodes = {n.namespace + n.name: {"type": f"{n.package}/{n.type}", "args": n.args, "respawn": n.respawn,
                                "remaps": {str(a): str(b) for a, b in n.remap_args}} for n in config.nodes}
print(json.dumps({"nodes": nodes, "params": {k: p.value for k, p in config.params.items()}}, default=str))
"""
# what realsense2_camera 2.3 declares in its includes/nodelet.launch.xml, as far as anybody here
# gives it
_REALSENSE_ARGS = (
    "manager tf_prefix device_type serial_no respawn initial_reset enable_color color_width color_height color_fps"
    " enable_infra1 infra_width infra_height infra_fps enable_depth align_depth depth_width"
    " depth_height depth_fps publish_tf enable_pose enable_fisheye1"
    " enable_fisheye2 publish_odom_tf"
).split()


def fake_realsense(folder):
    """A package of the driver's name whose launch file takes the driver's arguments and keeps them
    as parameters."""
    package = folder / "realsense2_camera"
    (package / "launch/includes").mkdir(parents=True)
    (package / "package.xml").write_text(
        "<package><name>realsense2_camera</name><version>2.3.2</version><description>x</description>"
        "<maintainer email='a@b.c'>x</maintainer><license>x</license></package>"
    )
    args = "".join(f'<arg name="{a}" default="unset"/>' for a in _REALSENSE_ARGS)
    params = "".join(f'<param name="{a}" type="str" value="$(arg {a})"/>' for a in _REALSENSE_ARGS)
    (package / "launch/includes/nodelet.launch.xml").write_text(
        f"<launch>{args}<node pkg='nodelet' type='nodelet' name='realsense2_camera_manager' args='manager'/>"
        f"<node pkg='nodelet' type='nodelet' name='realsense2_camera' args='load'>{params}</node></launch>"
    )
    return folder


def launched(path, *arguments, packages=None):
    """{"nodes": {name: {type, args, respawn, remaps}}, "params": {name: value}}, or {"error":
    text}."""
    found = os.environ.get("ROS_PACKAGE_PATH", "")
    env = dict(os.environ, ROS_PACKAGE_PATH=f"{packages}:{found}" if packages else found)
    command = [sys.executable, "-c", _READ, str(path), *arguments]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])
