# SPDX-License-Identifier: Apache-2.0
"""A sweep against stops: the map, and the time from the first set-point to it; the table of
docs/lab/sweep.md.

python tools/bench_sweep.py [--missions sweep short] [--seeds 1 2] [--offset-ms 5] [--picture FILE]

Each mission is rehearsed (airframes, autopilots, mission, radio, people; no ROS). Along the way
that was truly flown, with the airframes' vibration, each vehicle's simulated T265 (drift, noise)
gives poses at 200 Hz, and its camera, whose stamps are --offset-ms early, takes pictures at 6 Hz.
Calibration and home have the errors of a rehearsal. Then `joint` maps what was recorded.
"""

import argparse
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np

from fcsv_control.mission.activities.activity import CaptureWindow
from fcsv_geometry import transforms
from fcsv_geometry.home import camera_in_home, home_of
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.trajectory import Trajectory
from fcsv_geometry.vehicles.tracker import T265_PROFILE
from fcsv_sim.bringup import mission_file
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.sensors.t265 import T265
from fcsv_sim.vehicles.vehicle import PASS_S
from fcsv_sim.world.town import Town
from fcsv_stereo.evaluating.evaluation import band
from fcsv_stereo.model import FLOWN, Configuration, ConfigurationInput, InputKind, MapInput, Picture
from fcsv_stereo.pipeline import DEFAULT_METHOD, METHODS
from fcsv_stereo.sweeps import on_time, spread
from harness import grid, head, line, measured, picture

PICTURES_HZ, TRACKER_EVERY = 6.0, 2  # of 400 steps a second
CALIBRATION_M, CALIBRATION_RAD = 0.03, np.radians(0.3)  # as in fcsv_sim.rehearsal.control
BEFORE_S = 20.0  # the trackers' drift is of the way flown since
MIDDLE = 3  # pictures of each stop: `joint` takes the middle one
HEAD = (
    "mission",
    "seed",
    "pairs",
    "to the last picture (s)",
    "map, processor time (s)",
    "map, wall (s)",
    "to the map (s)",
    "within 10 % to 400 m",
    "0–50 m",
    "50–100 m",
    "100–200 m",
    "200–400 m",
    "wrong of answered",
    "time offset found",
)
RANGES_M = ((0.0, 400.0), (0.0, 50.0), (50.0, 100.0), (100.0, 200.0), (200.0, 400.0))
_MIDDLES_M = [0.5 * (near + far) for near, far in RANGES_M[1:]]


@dataclass
class Flown:
    """What a rehearsal left: T_world_body with vibration of each vehicle (stamp, xyz, q xyzw) 400
    times a second."""

    states: Dict[str, List[np.ndarray]] = field(default_factory=dict)
    phases: Dict[str, float] = field(default_factory=dict)  # when each began, s
    captures: List[CaptureWindow] = field(default_factory=list)
    detail: str = ""

    def felt(self, name: str) -> np.ndarray:
        """(N, 8)."""
        return np.concatenate(self.states[name])

    def first_set_point_s(self) -> float:
        """When the list began."""
        return self.phases["CONFIGURATIONS"]


def fly(mission_name: str, seed: int) -> Tuple[Flight, Flown]:
    """A rehearsed flight without faults, recorded."""
    flight, flown = Flight(load_mission(mission_file(mission_name)), 2, seed), Flown()
    for name, vehicle in flight.fleet.items():
        flown.states[name] = []
        vehicle.body.advance = _recording(
            flight, vehicle.body, vehicle.body.advance, flown.states[name]
        )

    def look(f: Flight) -> None:
        flown.phases.setdefault(f.phase, f.now_s)

    flight.recorder = look
    result = flight.run()
    if result.phase != "DONE" or result.violations:
        raise SystemExit(
            f"{mission_name}, seed {seed}: {result.phase} ({result.detail}), {result.violations}"
        )
    flown.captures, flown.detail = flight.control.captures, result.detail
    return flight, flown


def _recording(flight: Flight, body, advance, rows: list):
    def advanced(command, steps: int) -> np.ndarray:
        states = advance(command, steps)
        rows.append(body.felt(states, flight.now_s - PASS_S, command[3])[:, :8])
        return states

    return advanced


# ---- what cameras and trackers saw on it ---------------------------------------------------------


class Seen:
    """Poses and pictures of one flight, the stamps of all cameras ``offset_s`` early."""

    def __init__(self, flight: Flight, flown: Flown, seed: int, offset_s: float):
        self._flown, self._offset_s = flown, offset_s
        self.vehicles = {n: v.geometry for n, v in flight.fleet.items()}
        self.reference = flight.mission.reference
        begin_s = flown.phases["MOVE_HOME"] - BEFORE_S
        self.truth, self.tracks = {}, {}
        for name, geometry in self.vehicles.items():
            felt = flown.felt(name)
            felt = felt[felt[:, 0] > begin_s]
            tracker = T265(T265_PROFILE, geometry.T_body_t265, seed * 100 + geometry.system_id)
            self.truth[name], self.tracks[name] = Trajectory(), Trajectory()
            for k, row in enumerate(felt):
                T_world_body = transforms.from_xyz_quaternion(row[1:4], row[4:8])
                self.truth[name].add(float(row[0]), T_world_body)
                if k % TRACKER_EVERY == 0:
                    T_odom_t265 = tracker.odometry(float(row[0]), T_world_body)[0]
                    T_odom_body = T_odom_t265 @ transforms.invert(geometry.T_body_t265)
                    self.tracks[name].add(float(row[0]), T_odom_body)
        self.T_home_odom = self._home(seed)
        renderer = Renderer(Town.generate(1))
        parameters = CameraParameters(distortion=(0.0,) * 5)
        self._cameras = {
            n: SimulatedCamera(renderer, g.T_body_cam, parameters, seed * 10 + g.system_id)
            for n, g in self.vehicles.items()
        }
        self.depth: Dict[str, np.ndarray] = {}  # true, of the reference's pictures
        self._pictures: Dict[str, Picture] = {}

    def _home(self, seed: int) -> Dict[str, np.ndarray]:
        random, at_s = np.random.default_rng([seed, 22]), self._flown.phases["MOVE_HOME"]
        T_world_odom = {
            n: self.truth[n].at(at_s) @ transforms.invert(t.at(at_s))
            for n, t in self.tracks.items()
        }
        T_odom_cam = self.tracks[self.reference].at(self._flown.phases["GUIDED"])
        T_home_odom_ref = transforms.invert(
            home_of(T_odom_cam @ self.vehicles[self.reference].T_body_cam)
        )
        found = {self.reference: T_home_odom_ref}
        for name in [n for n in self.vehicles if n != self.reference]:
            d = random.standard_normal(4)
            error = transforms.from_xyz_yaw(d[:3] * CALIBRATION_M, d[3] * CALIBRATION_RAD)
            T = transforms.level(
                transforms.invert(T_world_odom[self.reference]) @ T_world_odom[name]
            )
            found[name] = T_home_odom_ref @ error @ T
        return found

    def posed(self, name: str, stamp_s: float) -> np.ndarray:
        """T_home_cam at a stamp of the tracker."""
        T_body_cam = self.vehicles[name].T_body_cam
        return camera_in_home(self.T_home_odom[name], self.tracks[name].at(stamp_s), T_body_cam)

    def picture(self, name: str, at_s: float) -> Picture:
        """Taken at a true time, with the pose that its stamp leads to."""
        stamp_s = at_s - self._offset_s
        key = f"{name}/{stamp_s:.3f}"
        if key not in self._pictures:
            shot = self._cameras[name].shoot(stamp_s, self.truth[name].at(at_s))
            if name == self.reference:
                self.depth[key] = shot.depth
            T_home_cam, model = self.posed(name, stamp_s), self._cameras[name].model
            self._pictures[key] = Picture(key, name, stamp_s, shot.rgb, model, T_home_cam)
        return self._pictures[key]

    def recording(self, mission, window: CaptureWindow) -> ConfigurationInput:
        """Pictures of a window; of a stop only the middle ones."""
        c = mission.configurations[window.index]
        first, last = (int(np.ceil(t * PICTURES_HZ)) for t in (window.start_s, window.stop_s))
        times_s = np.arange(first, last) / PICTURES_HZ
        if c.sweep is None:
            times_s = times_s[len(times_s) // 2 - MIDDLE // 2 :][:MIDDLE]
        sides = [
            [self.picture(n, float(t)) for t in times_s] for n in (self.reference, window.vehicle)
        ]
        configuration = Configuration(c.axis, c.baseline_m, c.tilt_rad, c.title)
        return ConfigurationInput(configuration, *sides)


def measure(mission_name: str, seed: int, offset_s: float) -> List[str]:
    """A row of the table."""
    flight, flown = fly(mission_name, seed)
    seen = Seen(flight, flown, seed, offset_s)
    recorded = [seen.recording(flight.mission, w) for w in flown.captures]
    begun_cpu_s, begun_s = time.process_time(), time.monotonic()
    R_body_cam = {n: g.T_body_cam[:3, :3] for n, g in seen.vehicles.items()}
    recorded, clocks, _ = on_time(recorded, seen.tracks, R_body_cam, seen.posed)
    given = MapInput(InputKind.SESSION, spread(recorded), prior=FLOWN, clocks=clocks)
    method = METHODS[DEFAULT_METHOD]
    result = method.map(given, method.options(), lambda *_: None)
    cpu_s, wall_s = time.process_time() - begun_cpu_s, time.monotonic() - begun_s
    flight_s = flown.captures[-1].stop_s - flown.first_set_point_s()
    whole, *bands = [band(result.depth, seen.depth[result.reference.name], r) for r in RANGES_M]
    offsets = ", ".join(f"{v} {c.words}" for v, c in clocks.items()) or "–"
    return [
        mission_name,
        str(seed),
        str(len(given.configurations)),
        f"{flight_s:.1f}",
        f"{cpu_s:.1f}",
        f"{wall_s:.1f}",
        f"{flight_s + cpu_s:.1f}",
        f"{whole.within_10_percent:.1%}",
        *(f"{b.within_10_percent:.0%}" for b in bands),
        f"{whole.wrong_of_answered:.1%}",
        offsets,
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--missions",
        nargs="+",
        default=["sweep", "short", "simulated_400m"],
        help="names in config/missions",
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2], help="of the flights")
    parser.add_argument(
        "--offset-ms", type=float, default=5.0, help="by which the cameras' stamps are early"
    )
    parser.add_argument(
        "--picture", type=Path, help="shares within 10 %% by distance, as a picture"
    )
    args = parser.parse_args()
    cases = grid(seed=args.seeds, mission_name=args.missions, offset_s=[args.offset_ms / 1e3])
    curves = {}
    print(head(HEAD), flush=True)
    for case, row in measured(measure, cases):
        print(line(row), flush=True)
        shares = [float(row[HEAD.index(title)].rstrip("%")) for title in HEAD[8:12]]
        curves[f"{case['mission_name']}, seed {case['seed']}"] = (_MIDDLES_M, shares)
    if args.picture:
        picture(args.picture, curves, "true depth (m)", "within 10 % (%)")


if __name__ == "__main__":
    main()
