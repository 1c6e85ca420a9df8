# SPDX-License-Identifier: Apache-2.0
"""A simulated flight of the whole system in which processes die, as a program of its own, and what
is heard on board.

``fly`` starts it in slow motion. Its story: an agent stops; the mission dies and everybody is
stopped; the radio of the upper vehicle of a vertical configuration is gone for good.
"""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Callable, Dict, List

from fcsv_sim.demo.fleet import CONTROL, FleetPlan, SimulatedFleet
from fcsv_sim.machines.machines import node_process
from fcsv_sim.machines.slow_motion import slow_motion
from fcsv_sim.truth import TruthReader

LINK_HOLD_S = 6.0
# pauses outlast an agent's stop and what it takes to go on, 11 s; low, so that nobody lands for long
MISSION = """name: faults
home_height_m: 5.0
limits: {pause_s: 16}
configurations:
  - {axis: horizontal, baseline_m: 5.0, record_s: 3.0}
  - {axis: vertical, baseline_m: 5.0, record_s: 15.0}
"""
_AGENT_S = 8.0  # so long the agent is stopped
_ON_GROUND_M, _AT_REST_S = 0.3, 2.0
_DEAD_S, _ASKED_AGAIN_S = 4.0, 1.0


def fly(out: Path, limit_s: float = 700.0, program: str = __file__) -> Dict[str, List[dict]]:
    """By "story" and by vehicle what was heard, each with its time ``t`` (s, of one clock). Raises
    on a bad end."""
    command = [sys.executable, program, "fly", str(out)]
    with slow_motion():
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit_s)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-3000:]
    logs = {v: out / "run" / v / "ear.log" for v in ("uav1", "uav2")}
    return {
        "story": _lines(out / "story.log"),
        **{name: _lines(path) for name, path in logs.items()},
    }


def _lines(path: Path) -> List[dict]:
    return [
        json.loads(line)
        for line in path.read_text().splitlines()
        if line.startswith("{") and line.endswith("}")
    ]


class FaultedFleet(SimulatedFleet):
    """Whose guardians do not wait long for a control PC that is gone, and whose cameras take fewer
    pictures, at which nobody looks afterwards: they would slow the flight."""

    def _camera_args(self) -> Dict[str, object]:
        return {"camera_rate_hz": 2.5}

    def _vehicle_args(self, vehicle: str, index: int) -> Dict[str, object]:
        return {**super()._vehicle_args(vehicle, index), "link_hold_s": LINK_HOLD_S}

    def signal(self, machine: str, node: str, number: int) -> None:
        """To the process of a node; roslaunch starts anew what dies, not what is stopped."""
        node_process(self.machines[machine].folder, node).send_signal(number)


class Story:
    """What is done to the flight, in its order."""

    mission, fleet = MISSION, FaultedFleet

    def __init__(self, out: Path):
        (out / "mission.yaml").write_text(self.mission)
        self._plan = FleetPlan(out, out / "mission.yaml", seed=1, world="plain", ready_s=2.0)
        self._fleet, self._log = self.fleet(self._plan), open(out / "story.log", "w", buffering=1)
        self._said: List[str] = []
        self._truth = {v: TruthReader(self._plan.sim_folder, v) for v in self._plan.vehicles}

    def fly(self) -> None:
        """The whole flight; everything is stopped in the end."""
        try:
            self._fleet.start()
            for vehicle in self._plan.vehicles:
                command = [sys.executable, __file__, "ear", vehicle, str(self._plan.sim_folder)]
                self._fleet.machines[vehicle].run(command, "ear")
            self._go_on()
        finally:
            for vehicle in self._plan.vehicles:  # whoever is stopped cannot end by itself
                for node in ("agent", "relay"):
                    self._signal(vehicle, node, signal.SIGCONT)
            self._fleet.stop()

    def _go_on(self) -> None:
        # needs this fleet's master in the environment
        from fcsv_sim.demo.ros.mission_watch import MissionWatch

        self._play(MissionWatch(self._fleet.control, self._plan.vehicles, self._say))

    def _play(self, watch) -> None:
        self._hear("CONFIGURATIONS 1/2: uav2 on its way", 240.0)
        self._agent_stops()
        self._hear("CONFIGURATIONS 1/2: recording horizontal", 60.0)
        self._mission_dies()
        self._hear("CONFIGURATIONS 2/2: recording vertical", 90.0)
        self._radio_is_gone()
        self._until(lambda: watch.over and watch.landed, 60.0, "the mission did not end")

    def _agent_stops(self) -> None:
        time.sleep(0.5)
        self._note("agent stopped")
        self._signal("uav2", "agent", signal.SIGSTOP)
        time.sleep(_AGENT_S)
        self._note("agent goes on")
        self._signal("uav2", "agent", signal.SIGCONT)
        self._said.clear()

    def _mission_dies(self) -> None:
        import rospy
        from std_srvs.srv import Trigger

        from fcsv_msgs.srv import Proceed

        stop_all, proceed = (
            rospy.ServiceProxy("/stop_all", Trigger),
            rospy.ServiceProxy("/mission/proceed", Proceed),
        )
        stop_all.wait_for_service(10.0)
        self._signal(CONTROL, "mission", signal.SIGKILL)
        self._note("stop all")
        self._note(f"answer: {stop_all().message}")
        self._said.clear()
        asked_s = time.monotonic() + _DEAD_S

        def resumed() -> bool:
            nonlocal asked_s
            if any(s.startswith("GUIDED: handing over") for s in list(self._said)):
                return True  # the simulated operator was first
            if time.monotonic() < asked_s + _ASKED_AGAIN_S:
                return False
            asked_s = time.monotonic()
            try:
                return proceed("resume").success
            except rospy.ServiceException:
                return False  # the mission is not there again

        self._until(resumed, 30.0, "nobody could resume")
        self._note("resumed")

    def _radio_is_gone(self) -> None:
        self._note("radio cut")
        self._signal("uav2", "relay", signal.SIGSTOP)
        self._until_at_rest(120.0)
        self._note("on the ground")
        self._signal("uav2", "relay", signal.SIGCONT)

    def _until_at_rest(self, limit_s: float) -> None:
        since_s = time.monotonic()

        def at_rest() -> bool:
            nonlocal since_s
            if any(t.latest()[1][2, 3] > _ON_GROUND_M for t in self._truth.values()):
                since_s = time.monotonic()
            return time.monotonic() - since_s > _AT_REST_S

        self._until(at_rest, limit_s, "not everybody came down")

    # ---- what it stands on -----------------------------------------------------------------------

    def _signal(self, machine: str, node: str, number: int) -> None:
        self._fleet.signal(machine, node, number)

    def _note(self, text: str) -> None:
        self._log.write(json.dumps({"t": time.monotonic(), "what": text}) + "\n")

    def _say(self, line: str) -> None:
        self._said.append(line)
        self._note(f"said: {line}")
        print(f"{time.monotonic():.1f} {line}", flush=True)

    def _hear(self, words: str, limit_s: float) -> None:
        self._until(
            lambda: any(s.startswith(words) for s in list(self._said)),
            limit_s,
            f"'{words}' was not said",
        )

    def _until(self, condition: Callable[[], bool], limit_s: float, otherwise: str) -> None:
        deadline_s = time.monotonic() + limit_s
        while not condition():
            self._fleet.require_alive()
            if time.monotonic() > deadline_s:
                raise AssertionError(otherwise)
            time.sleep(0.05)


def listen(vehicle: str, sim_folder: str) -> None:
    """On a vehicle's own master: set-points by sender, the guardian, modes, and the true place, as
    lines of JSON."""
    import rospy
    from geometry_msgs.msg import PoseStamped

    from fcsv_geometry.errors import PoseUnavailable
    from fcsv_geometry.ros import node
    from fcsv_msgs.msg import GuardianState
    from mavros_msgs.msg import State

    def tell(what: str, **more) -> None:
        sys.stdout.write(json.dumps({"t": time.monotonic(), "what": what, **more}) + "\n")
        sys.stdout.flush()

    node.begin("ear", anonymous=True)
    on = lambda topic, kind, call: rospy.Subscriber(  # noqa: E731
        f"/{vehicle}/{topic}", kind, call, queue_size=20
    )
    on(
        "guardian/state",
        GuardianState,
        lambda m: tell("guardian", action=m.action, holds=m.holds, why=m.reasons),
    )
    on("mavros/state", State, lambda m: tell("state", mode=m.mode, armed=m.armed))
    on(
        "mavros/setpoint_position/local",
        PoseStamped,
        lambda m: tell("set-point", by=m._connection_header["callerid"].rsplit("/", 1)[-1]),
    )
    truth = TruthReader(sim_folder, vehicle)
    while not rospy.is_shutdown():
        try:
            tell("place", p=[float(x) for x in truth.latest()[1][:3, 3]])
        except PoseUnavailable:
            pass  # it is not there yet
        time.sleep(0.05)


if __name__ == "__main__":
    if sys.argv[1] == "ear":
        listen(*sys.argv[2:])
    else:
        Story(Path(sys.argv[2])).fly()
