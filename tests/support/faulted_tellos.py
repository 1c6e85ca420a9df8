# SPDX-License-Identifier: Apache-2.0
"""What goes wrong in a demo of two Tellos before a mocap, as a program beside it with its master
and its clock.

The tracker's program hangs for 3 s while horizontal pictures are recorded; the upper vehicle's
Wi-Fi is lost for 10 s in a vertical configuration; its battery falls to 8 % when all are to land.
Pilots end the landings that links began in the first two. What was heard, and where all truly were,
stands in ``story.log``.
"""

import contextlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Dict, List

from fcsv_geometry.errors import PoseUnavailable
from fcsv_sim.machines.machines import node_process

NAMES = ("tello1", "tello2")
UPPER = "tello2"
HANGS_S, SILENT_S, EMPTY_PERCENT = 3.0, 10.0, 8.0
_CAUGHT_S = 3.0  # so long after a fault pilots look for vehicles that land


def begin(out: Path) -> subprocess.Popen:
    """Beside a demo that is flown into ``out``, once it is there."""
    on_control = out / "run" / "on_control"
    while not on_control.exists():
        time.sleep(0.2)
    with open(out / "story.txt", "wb") as log:
        return subprocess.Popen(
            [str(on_control), sys.executable, __file__, str(out)], stdout=log, stderr=log
        )


def heard(out: Path) -> List[dict]:
    """Lines of story.log, in order of their time ``t`` (s)."""
    return [
        json.loads(line)
        for line in (out / "story.log").read_text().splitlines()
        if line.endswith("}")
    ]


class Story:
    """``tell`` is called until all are down, or the demo ends and stops its master."""

    def __init__(self, out: Path):
        import rospy
        from sensor_msgs.msg import Joy
        from std_msgs.msg import Float64

        from fcsv_geometry.ros import node
        from fcsv_msgs.msg import MissionState
        from fcsv_sim.truth import TruthReader
        from mavros_msgs.msg import State, StatusText

        self._out, self._log = out, open(out / "story.log", "w", buffering=1)
        self._mode: Dict[str, str] = {}
        self._said, self._phase = "", ""
        node.begin("story", anonymous=True, disable_signals=True)
        self._over = rospy.is_shutdown
        self._truth = {n: TruthReader(out / "run" / "sim", n) for n in NAMES}
        self._sticks = {n: rospy.Publisher(f"/{n}/pilot/joy", Joy, queue_size=1) for n in NAMES}
        self._stick = Joy(axes=[0.0, 0.5, 0.0, 0.0])
        self._cut = rospy.Publisher(f"/{UPPER}/tello_drone/cut_wifi_s", Float64, queue_size=1)
        self._battery = rospy.Publisher(
            f"/{UPPER}/tello_drone/battery_percent", Float64, queue_size=1
        )
        rospy.Subscriber("/mission/state", MissionState, self._on_mission)
        for n in NAMES:
            rospy.Subscriber(f"/{n}/mavros/state", State, self._on_state, n)
            rospy.Subscriber(
                f"/{n}/mavros/statustext/recv",
                StatusText,
                lambda m, n=n: self._note("text", n, m.text),
            )

    def tell(self) -> None:
        """The faults in their order; each is noted when it begins and when it ends."""
        self._until(lambda: "recording horizontal" in self._said)
        self._note("tracker hangs")
        self._signal_tracker(signal.SIGSTOP)
        try:
            self._wait(HANGS_S)
        finally:
            self._signal_tracker(signal.SIGCONT)
        self._note("tracker goes on")
        self._catch()
        self._until(lambda: "recording vertical 1 m" in self._said)
        self._note("Wi-Fi lost")
        self._cut.publish(SILENT_S)
        self._wait(SILENT_S)
        self._note("Wi-Fi back")
        self._catch()
        self._until(lambda: self._phase == "LAND")
        self._note("battery empty")
        self._battery.publish(EMPTY_PERCENT)
        self._until(lambda: self._phase in ("DONE", "ABORTED"))
        self._wait(1.0)

    def _catch(self) -> None:
        """The pilot of a vehicle that its link lands moves a stick."""
        end_s = time.monotonic() + _CAUGHT_S
        while time.monotonic() < end_s:
            for n in NAMES:
                if self._mode.get(n) == "LAND":
                    self._sticks[n].publish(self._stick)
            self._wait(0.05)

    def _signal_tracker(self, number: int) -> None:
        node_process(self._out / "run", "mocap_tracker").send_signal(number)

    def _on_mission(self, m) -> None:
        self._said, self._phase = m.detail, m.phase_name
        self._note("mission", "", f"{m.phase_name}: {m.detail} {list(m.problems)}")

    def _on_state(self, m, name: str) -> None:
        if self._mode.get(name) != m.mode:
            self._mode[name] = m.mode
            self._note("mode", name, m.mode)

    def _until(self, condition) -> None:
        while not condition():
            self._wait(0.05)

    def _wait(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            if self._over():
                sys.exit("the demo ended before its story did")
            with contextlib.suppress(PoseUnavailable):  # before all are there
                places = {
                    n: [round(float(x), 3) for x in t.latest()[1][:3, 3]]
                    for n, t in self._truth.items()
                }
                self._note("places", "", places)
            time.sleep(0.05)

    def _note(self, what: str, name: str = "", value=None) -> None:
        self._log.write(
            json.dumps({"t": time.monotonic(), "what": what, "name": name, "value": value}) + "\n"
        )


if __name__ == "__main__":
    Story(Path(sys.argv[1])).tell()
