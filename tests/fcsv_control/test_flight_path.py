# SPDX-License-Identifier: Apache-2.0
"""What keeps a vehicle's pose feed alive runs on the vehicle, and needs nothing else there."""

import json
import os
import sys
import time

import psutil
import pytest
from support.mavros_package import path_to_mavros

from fcsv_sim.machines.machines import Machine, free_port

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.slow_motion]


@pytest.mark.parametrize("flight_link", ["mavlink", "mavros"])
def test_odometry_reaches_the_autopilot_with_everything_else_frozen(
    flight_link, root, tmp_path, monkeypatch
):
    """Frozen, not killed, as roslaunch would start the killed again; the master, too."""
    port = free_port()
    if flight_link == "mavros":
        monkeypatch.setenv("ROS_PACKAGE_PATH", path_to_mavros(root, tmp_path))
    with Machine("uav1", tmp_path) as machine:
        machine.launch(
            "fcsv_bringup",
            "uav.launch",
            uav="uav1",
            sim=True,
            sim_dir=tmp_path / "sim",
            record_dir=tmp_path / "session",
            listen=f"127.0.0.1:{free_port()}/{free_port()}",
            flight_link=flight_link,
            fcu_url=f"udpin:127.0.0.1:{port}",
            sim_mavlink_port=port,
            sim_rc_port=free_port(),
            sim_ready_s=2.0,
        )
        out = tmp_path / "heard.jsonl"
        script = tmp_path / "ear.py"
        script.write_text(f"""
import rospy, json, time
from geometry_msgs.msg import PoseStamped
from fcsv_geometry.ros import node
node.begin('ear')
f = open({str(out)!r}, 'a', buffering=1)
for t in ('vision_pose', 'local_position'):
    rospy.Subscriber('/uav1/mavros/' + t + '/pose', PoseStamped,
                     lambda m, t=t: f.write(json.dumps([time.time(), t]) + chr(10)))
rospy.spin()
""")
        ear = machine.run([sys.executable, str(script)], "ear")

        def rates(seconds):
            since_s = time.time()
            time.sleep(seconds)
            names = [json.loads(x) for x in out.read_text().splitlines()] if out.exists() else []
            heard = [t for at_s, t in names if at_s >= since_s]
            return {t: heard.count(t) / seconds for t in ("vision_pose", "local_position")}

        deadline = time.monotonic() + 90
        while min(rates(2.0).values()) < 2.0:
            assert time.monotonic() < deadline, "odometry never reached the autopilot"
        own = f":{machine.port}"
        path = ("sim_vehicle", "t265", "odometry", "flight_link", "mavros")
        frozen = []
        for p in psutil.process_iter(["environ", "cmdline"]):
            command = " ".join(p.info["cmdline"] or [])
            if not (p.info["environ"] or {}).get("ROS_MASTER_URI", "").endswith(own) or p.pid in (
                ear.pid,
                os.getpid(),
            ):
                continue
            if not any(f"__name:={n}" in command.split() for n in path):
                frozen.append(p)
        names = " ".join(" ".join(p.info["cmdline"]) for p in frozen)
        assert "__name:=relay" in names and "__name:=agent" in names and "rosmaster" in names
        try:
            for p in frozen:
                p.suspend()
            during = rates(4.0)
        finally:
            for p in frozen:
                p.resume()
        # 30 Hz and 10 Hz nominal
        assert during["vision_pose"] > 15.0 and during["local_position"] > 5.0, during
