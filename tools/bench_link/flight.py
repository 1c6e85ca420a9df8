# SPDX-License-Identifier: Apache-2.0
"""A simulated flight whose machines hear each other only over the emulated radio, and the map of
it.

Every machine is a network namespace; what in the field is no radio network stays none: transmitters
reach their vehicles, and everybody sees the world.
"""

import json
import os
import select
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Callable, Dict, List, Tuple

from machines import PORT, NamespaceMachine
from radio import Conditions, Radio, in_namespace

from fcsv_multimaster.keys.keyring import make_fleet
from fcsv_sim.demo.fleet import CONTROL, FleetPlan, SimulatedFleet
from fcsv_sim.demo.truth_export import export_truth
from fcsv_sim.machines.machines import MachineError
from fcsv_sim.machines.slow_motion import slow_motion


class RadioFleet(SimulatedFleet):
    """The demo's fleet, with keys, in the namespaces of a radio."""

    def __init__(self, plan: FleetPlan, radio: Radio):
        super().__init__(plan)
        self._radio = radio
        self.machines = {
            n: NamespaceMachine(n, plan.run_folder, radio.namespace(n)) for n in self.machines
        }
        self._keys = plan.run_folder / "keys"
        make_fleet(self._keys, tuple(self.machines))
        self._transmitters = Transmitters(radio, self.rc_ports)

    def common_args(self, name: str) -> Dict[str, object]:
        others = {n: a for n, a in self._radio.addresses.items() if n != name}
        links = {
            "listen": f"0.0.0.0:{PORT}",
            "peers": ",".join(f"{n}={a}:{PORT}" for n, a in others.items()),
            "keys": self._keys / name,
        }
        return {**super().common_args(name), **links}

    def stop(self) -> None:
        super().stop()
        self._transmitters.close()


class Transmitters:
    """Carries RC frames from the operators (beside the control PC) to the vehicles: another radio,
    which works."""

    def __init__(self, radio: Radio, ports: Dict[str, int]):
        self._ways = {}
        for vehicle, port in ports.items():
            received = in_namespace(radio.namespace(CONTROL), lambda p=port: _udp(("127.0.0.1", p)))
            self._ways[received] = in_namespace(radio.namespace(vehicle), _udp), ("127.0.0.1", port)
        self._stop, self._wake = os.pipe()
        self._thread = threading.Thread(target=self._run, name="transmitters", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop carrying. Safe to call again."""
        if self._thread.is_alive():
            os.write(self._wake, b"x")
            self._thread.join()
            for received, (sent, _) in self._ways.items():
                received.close()
                sent.close()

    def _run(self) -> None:
        while True:
            ready, _, _ = select.select([*self._ways, self._stop], [], [])
            if self._stop in ready:
                return
            for received in ready:
                sent, address = self._ways[received]
                try:
                    sent.sendto(received.recv(64), address)
                except ConnectionRefusedError:
                    pass  # the receiver is off; a transmitter does not notice


def _udp(address=None) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    if address is not None:
        opened.bind(address)
    return opened


def fly(
    plan: FleetPlan,
    conditions: Conditions,
    cut_s: float,
    cut_at: str,
    limit_s: float = 420.0,
    clock: Callable[[], float] = time.monotonic,
    during_cut: Callable[[float], None] = lambda _since_s: None,
) -> List[str]:
    """Fly a plan's mission, with nothing carried for ``cut_s`` seconds once its state begins with
    ``cut_at``.

    ``clock`` is that of the fleet, where it flies in slow motion. ``during_cut`` is called again
    and again with the seconds since the cut. Returns what the mission said, line by line. Raises
    MachineError where it does not end, or not well.
    """
    from fcsv_sim.demo.demo import build_world  # not for the watch
    from fcsv_sim.demo.narration import Narrator

    build_world(plan, Narrator())
    with Radio((*plan.vehicles, CONTROL), conditions, clock=clock) as radio:
        fleet = RadioFleet(plan, radio)
        try:
            fleet.start()
            watch = fleet.control.run([sys.executable, __file__, *plan.vehicles], "watch")
            deadline, mended_s = clock() + limit_s, None
            while watch.returncode is None and clock() < deadline:
                time.sleep(0.1)
                if mended_s is None and f"\n{cut_at}" in "\n" + watch.tail(3):
                    radio.cut()
                    mended_s = clock() + cut_s
                elif mended_s is not None and clock() > mended_s:
                    radio.mend()
                elif mended_s is not None:
                    during_cut(clock() - (mended_s - cut_s))
            if watch.returncode != 0:
                raise MachineError(
                    f"the mission did not end well ({watch.returncode}):\n{watch.tail(20)}"
                )
            if mended_s is None:
                raise MachineError(
                    f"the mission never said '{cut_at}', nothing was cut:\n{watch.tail(20)}"
                )
        finally:
            fleet.stop()
    export_truth(plan.sim_folder, plan.session_folder, plan.vehicles)
    return watch.log.read_text().splitlines()


def make_map(plan: FleetPlan) -> Dict:
    """The report of the session's map. Raises MachineError."""
    out = plan.folder / "map"
    command = ["rosrun", "fcsv_stereo", "map", str(plan.session_folder), "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise MachineError(f"no map of {plan.session_folder}: {done.stderr[-2000:]}")
    return json.loads((out / "report.json").read_text())


def whole_mission(conditions: Conditions, cut_s: float) -> Tuple[str, str]:
    """What was flown, and what came of it, for the table. Raises MachineError."""
    mission = Path(__file__).resolve().parents[2] / "config" / "missions" / "short.yaml"
    with tempfile.TemporaryDirectory(prefix="bench-link-") as folder:
        plan = FleetPlan(Path(folder), mission)
        with slow_motion() as page:
            began_s = time.monotonic(), page.now_s()
            *_, last = fly(plan, conditions, cut_s, "CONFIGURATIONS 2/4", clock=page.now_s)
            speed = (page.now_s() - began_s[1]) / (time.monotonic() - began_s[0])
        truth = make_map(plan)["truth"]
    radio = f"{100 * conditions.loss:.0f} % loss, {1e3 * conditions.delay_s:.0f} ms delay each way"
    what = f"the demo's mission at {radio}, a cut of {cut_s:.0f} s in its second configuration"
    return (
        what,
        f"{last} at {speed:.2f} of real time; map within 10 %: {100 * truth['within_10_percent']:.1f} %",
    )


def watch(vehicles: List[str]) -> int:
    """Inside the control PC's namespace: say what the mission says; 0 once it is done and everybody
    has landed."""
    from fcsv_sim.demo.ros.mission_watch import MissionWatch

    seen = MissionWatch(
        SimpleNamespace(env=os.environ), vehicles, lambda line: print(line, flush=True)
    )
    while not (seen.over and seen.landed):
        time.sleep(0.2)
    print(f"flown {seen.flown_s:.0f} s", flush=True)
    return 1 if seen.aborted else 0


if __name__ == "__main__":
    sys.exit(watch(sys.argv[1:]))
