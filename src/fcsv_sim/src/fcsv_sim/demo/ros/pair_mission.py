# SPDX-License-Identifier: Apache-2.0
"""A mission's configurations flown by a pair of Tellos before a tracker on the ground: from take-off to landing."""

import itertools
import time
from typing import Callable, Dict, List, Tuple

import numpy as np
import rospy

from fcsv_control.mission.places import T_HOME_CAM_AT_HOME, camera_place, heading_error_rad
from fcsv_control.mission.routes import Keep, route
from fcsv_control.mission.standing import CaptureWindow
from fcsv_geometry import transforms
from fcsv_geometry.mission import Mission
from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicle import VehicleGeometry
from fcsv_msgs.msg import Home
from fcsv_msgs.srv import SetHome, SetHomeResponse
from fcsv_sim.demo.fleet import FleetPlan, SimulatedPair
from fcsv_sim.demo.movement import Movement
from fcsv_sim.demo.ros.pair_cameras import PairCamera
from fcsv_sim.demo.ros.pair_pilots import PairPilots
from fcsv_sim.demo.ros.pair_session import PairSession
from fcsv_sim.demo.site import PairSite
from fcsv_sim.machines.machines import MachineError

_START_S, _STEP_S, _LAND_S = 300.0, 300.0, 90.0  # a busy machine is slow to start
_THERE_M, _IN_LINE_M = 0.35, 0.2
_APART_M = 0.8
_LINE_S = 10.0


class PairMission:
    """fly() tells the story; land() and close() whatever happens. ``pair`` holds the processes."""

    def __init__(self, plan: FleetPlan, site: PairSite, mission: Mission, vehicles: Dict[str, VehicleGeometry],
                 pair: SimulatedPair, say: Callable[[str], None]):  # fmt: skip
        self._plan, self._site, self._mission, self._pair, self._say = plan, site, mission, pair, say
        self._names = list(vehicles)
        self._session = PairSession(plan.session_folder, mission, vehicles, plan.seed)
        self._movements = {n: Movement() for n in vehicles}
        self.moved_m = self.flown_s = 0.0
        self._counting, self._next_line_s = False, time.monotonic() + _LINE_S
        self._cameras = {n: PairCamera(n, self._on_pose) for n in vehicles}
        self._pilots = PairPilots(plan.sim_folder, vehicles, self._cameras, site.sway_m)
        self._places = dict.fromkeys(vehicles, T_HOME_CAM_AT_HOME)
        self._set_home = rospy.ServiceProxy("/set_home", SetHome)

    def fly(self) -> None:
        """Raises MachineError where something does not come about, MissionError where there is no way."""
        self._wait_for_all()
        begun_s = time.monotonic()
        self._take_off()
        self._find_home()
        self._counting = True
        for index in range(len(self._mission.configurations)):
            self._fly_configuration(index)
        self._counting = False
        self.land()
        self.flown_s = time.monotonic() - begun_s

    # -- the way to home --------------------------------------------------------------------------------------------

    def _wait_for_all(self) -> None:
        self._say("WAIT_VEHICLES: the Tellos and their cameras are to come up")
        self._until(lambda: self._pilots.all_there, _START_S, "not every simulated Tello came up")
        self._until(lambda: all(c.pictures for c in self._cameras.values()), _START_S, "no pictures from the cameras")

    def _home_service_there(self) -> bool:
        try:
            self._set_home.wait_for_service(0.05)
            return True
        except rospy.ROSException:
            return False

    def _take_off(self) -> None:
        self._say("TAKE_OFF: both by themselves, then by hand to where the tracker sees them")
        self._until(self._all_off_the_ground, _STEP_S, "the vehicles did not take off")
        self._line_up()

    def _all_off_the_ground(self) -> bool:
        self._pilots.order("takeoff")
        return all(s.mode == "FLY" for s in self._pilots.states.values())

    def _line_up(self, aside_m: float = 0.0) -> None:
        for name, T in self._site.line_up(self._mission, self._names).items():
            self._pilots.by_sight(name, transforms.transform(T[:3, :3], T[:3, 3] + [0.0, aside_m, 0.0]))
        self._until(self._lined_up, _STEP_S, "the pilots could not line the vehicles up")

    def _lined_up(self) -> bool:
        return all(self._pilots.seen_away_m(n) < _IN_LINE_M for n in self._names)

    def _find_home(self) -> None:
        """Ask for home until the tracker grants it and knows every vehicle; in between all sway, where it helps."""
        self._say("SET_HOME: the tracker is to find both vehicles")
        self._pair.launch_tracker()
        self._until(self._home_service_there, _START_S, "the tracker offers no /set_home")
        deadline, why = time.monotonic() + _STEP_S, ""
        for side in itertools.cycle((1.0, -1.0)):
            if self._site.sway_m:
                self._line_up(side * self._site.sway_m)
            answer = self._ask_for_home()
            if answer.message != why:
                why = answer.message
                self._say(f"    {why}")
            if answer.success and self._wait_known(10.0):
                break
            if time.monotonic() > deadline:
                raise MachineError(f"home could not be set in {_STEP_S:.0f} s ({why}); {self._logs}")
            self._pause(1.0)
        T_odom_home = conversions.pose_to_transform(answer.home.home_in_odom)
        self._session.begin(time.time(), T_odom_home if self._site.session_in_odometry else np.eye(4))
        self._pilots.by_tracker(self._mission.reference, T_HOME_CAM_AT_HOME)
        for name in self._names:
            if name != self._mission.reference:
                self._hold(name)

    def _ask_for_home(self) -> SetHomeResponse:
        try:
            return self._set_home(self._mission.reference)
        except rospy.ServiceException as error:  # it is being started again, or too busy to answer
            return SetHomeResponse(False, f"/set_home: {error}", Home())

    def _hold(self, name: str) -> None:
        """Where it is, looking along home's x."""
        p = self._cameras[name].latest()[1][:3, 3]
        self._places[name] = transforms.transform(T_HOME_CAM_AT_HOME[:3, :3], p)
        self._pilots.by_tracker(name, self._places[name])

    def _wait_known(self, timeout_s: float) -> bool:
        """Whether the tracker gives a sure pose of everybody within a while."""
        until_s = time.monotonic() + timeout_s
        while time.monotonic() < until_s:
            if all(c.known(time.time()) for c in self._cameras.values()):
                return True
            self._pause(0.1)
        return False

    # -- a configuration --------------------------------------------------------------------------------------------

    def _fly_configuration(self, index: int) -> None:
        c, total = self._mission.configurations[index], len(self._mission.configurations)
        mover = self._mission.mover(index, self._names)
        self._say(f"CONFIGURATIONS {index + 1}/{total}: {mover} to {c.title}")
        self._go(mover, camera_place(c))
        for attempt in range(self._mission.settle.attempts):
            self._settle(c.title)
            window, pictures = self._record(index, mover)
            if window.position_error_m <= self._mission.settle.hold_m:
                break
            self._say(f"    left its place by {window.position_error_m:.2f} m while recording (attempt {attempt + 1})")
        for name, kept in pictures.items():
            for image, info, T_home_cam in kept:
                self._session.picture(name, image, info, T_home_cam)
        self._session.capture(window, time.time())
        self._say(f"captured {c.title}: set-point held within {window.position_error_m:.2f} m")

    def _go(self, name: str, T_home_cam: np.ndarray) -> None:
        """Way-point by way-point, clear of the others. Raises MissionError where there is no way."""
        others = [self._cameras[n].latest()[1][:3, 3] for n in self._names if n != name]
        keep = Keep(self._mission.min_separation_m)  # a Tello of 80 g has no downwash to speak of
        way = route(self._cameras[name].latest()[1][:3, 3], T_home_cam[:3, 3], others, keep)
        for p_home in way:
            self._places[name] = transforms.transform(T_home_cam[:3, :3], p_home)
            self._pilots.by_tracker(name, self._places[name])
            self._until(lambda: self._error_m([name]) < _THERE_M, _STEP_S, f"{name} did not get to a way-point")

    def _settle(self, title: str) -> None:
        """Until everybody stood calmly for as long as the mission asks."""
        calm_since_s, deadline = time.monotonic(), time.monotonic() + _STEP_S
        while time.monotonic() - calm_since_s < self._mission.settle.time_s:
            if not all(self._calm(n) for n in self._names):
                calm_since_s = time.monotonic()
            if time.monotonic() > deadline:
                raise MachineError(f"nobody settled at {title} in {_STEP_S:.0f} s: {self._in_words()}; {self._logs}")
            self._pause(0.1)

    def _calm(self, name: str) -> bool:
        bounds, camera, latest = self._mission.settle, self._cameras[name], self._cameras[name].latest()
        return (
            camera.known(time.time())
            and camera.age_s(time.time()) < bounds.pose_age_s
            and self._error_m([name]) < bounds.position_m
            and heading_error_rad(latest[1], self._places[name]) < np.radians(bounds.heading_deg)
            and camera.speed_mps() < bounds.speed_mps
        )

    def _record(self, index: int, mover: str) -> Tuple[CaptureWindow, Dict[str, List]]:
        """Pictures of the reference and of the mover, each with its pose, for as long as it takes to have enough."""
        cameras = {n: self._cameras[n] for n in (self._mission.reference, mover)}
        wanted = self._mission.configurations[index]
        until_s, worst = time.monotonic() + wanted.record_s, [0.0]

        def enough() -> bool:
            worst[0] = max(worst[0], self._error_m(cameras))
            return time.monotonic() >= until_s and all(len(c.kept()) >= wanted.least_pictures for c in cameras.values())

        for camera in cameras.values():
            camera.record(True)
        few = f"fewer than least_pictures ({wanted.least_pictures}) with a pose came of {' or '.join(cameras)}"
        self._until(enough, _STEP_S + wanted.record_s, few)
        pictures = {n: c.kept() for n, c in cameras.items()}
        for camera in cameras.values():
            camera.record(False)
        stamps = [image.header.stamp.to_sec() for kept in pictures.values() for image, _, _ in kept]
        return CaptureWindow(index, mover, min(stamps) - 1e-3, max(stamps) + 1e-3, worst[0]), pictures

    def _error_m(self, names) -> float:
        """Largest distance (m) of a camera from its place, by the tracker."""
        return max(float(np.linalg.norm(self._cameras[n].latest()[1][:3, 3] - self._places[n][:3, 3])) for n in names)

    # -- the end ----------------------------------------------------------------------------------------------------

    def land(self) -> None:
        """Both down, side by side; best effort where the tracker has lost them. Raises MachineError."""
        if self._pilots.all_landed:
            return
        self._say("LAND")
        self._part()
        deadline = time.monotonic() + _LAND_S
        while not self._pilots.all_landed:
            if time.monotonic() > deadline:
                raise MachineError(f"not landed after {_LAND_S:.0f} s; {self._logs}")
            self._pilots.order("land")
            time.sleep(0.5)

    def _part(self) -> None:
        """One above the other: the upper one goes aside first, for ten seconds at most."""
        poses = {n: c.latest() for n, c in self._cameras.items()}
        if any(p is None for p in poses.values()):
            return
        p = {n: T[:3, 3] for n, (_, T) in poses.items()}
        upper, lower = sorted(p, key=lambda n: -p[n][2])
        if np.linalg.norm(p[upper][:2] - p[lower][:2]) > _APART_M:
            return
        aside = p[lower] + [0.0, -1.5 * _APART_M, p[upper][2] - p[lower][2]]
        self._pilots.by_tracker(upper, transforms.transform(T_HOME_CAM_AT_HOME[:3, :3], aside))
        until_s = time.monotonic() + 10.0
        while time.monotonic() < until_s:
            if np.linalg.norm((self._cameras[upper].latest()[1][:3, 3] - p[lower])[:2]) > _APART_M:
                return
            time.sleep(0.1)

    def close(self) -> None:
        """The session's bags get their names."""
        self._session.close()

    # -- meanwhile --------------------------------------------------------------------------------------------------

    def _on_pose(self, name: str, message) -> None:
        self._session.camera_pose(name, message)
        p = message.pose.pose.position
        step_m = self._movements[name].add((p.x, p.y, p.z))
        if self._counting:
            self.moved_m += step_m

    def _until(self, condition: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                raise MachineError(f"{otherwise} in {timeout_s:.0f} s: {self._in_words()}; {self._logs}")
            self._pause(0.1)

    def _pause(self, seconds: float) -> None:
        self._pair.require_alive()
        if time.monotonic() > self._next_line_s:
            self._next_line_s = time.monotonic() + _LINE_S
            self._say(f"    {self._in_words()}")
        time.sleep(seconds)

    @property
    def _logs(self) -> str:
        return f"logs: {self._plan.run_folder}"

    def _in_words(self) -> str:
        words = []
        for name, camera in self._cameras.items():
            state, latest = self._pilots.states.get(name), camera.latest()
            where = "no pose" if latest is None else "at ({:.1f}, {:.1f}, {:.1f}) in home".format(*latest[1][:3, 3])
            age_s = camera.age_s(time.time())
            old = f" {age_s:.0f} s ago" if 1.0 < age_s < np.inf else ""
            words.append(f"{name} {state.mode if state else 'silent'} {where}{old}, {camera.pictures} pictures")
        return " | ".join(words)
