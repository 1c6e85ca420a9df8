# SPDX-License-Identifier: Apache-2.0
"""From where each user of a condition calls it amber and red: one condition a line, users beside
each other.

What is worse than a bound is so; at the bound it is not. The users' own rules (GuardianRules,
VehicleCheckRules, Mission, ...) have these as defaults, and a configuration file may change them
there. Red of the flight check forbids GUIDED; so it is never looser than what a guardian forbids.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Bounds:
    """NaN: this user has no such bound."""

    red: float = math.nan
    amber: float = math.nan


@dataclass(frozen=True)
class Thresholds:
    """The bounds of one condition, by user. ``why``: what makes them differ."""

    what: str  # with its unit, and which side is worse
    check: Bounds = Bounds()  # a vehicle's own flight check: red forbids GUIDED
    fleet: Bounds = Bounds()  # what the control PC adds to it
    guardian: Bounds = Bounds()  # amber: it warns or holds; red: it lands, or forbids GUIDED
    agent: Bounds = Bounds()  # red: it hands nobody over
    link: Bounds = Bounds()  # the flight link's own watch: amber is said, red lands
    mission: Bounds = Bounds()  # amber: it pauses; red: it lands all, or does not count on it
    stop_all: Bounds = Bounds()  # red: unheard, and asked again
    tello: Bounds = Bounds()  # a Tello's link: amber holds or is said, red lands
    recorder: Bounds = Bounds()  # red: it ends its recording
    calibration: Bounds = Bounds()  # red: it refuses
    console: Bounds = Bounds()  # red: shown as old
    pilot: Bounds = Bounds()  # red: simulated ones land, as people are told to
    why: str = ""


# ---- what is measured ----------------------------------------------------------------------------

BATTERY = Thresholds(
    "share of the battery's charge, below",
    check=Bounds(0.2, 0.4),
    guardian=Bounds(0.1, 0.2),
    mission=Bounds(0.1, 0.2),
    tello=Bounds(0.1, 0.2),
    pilot=Bounds(0.2),
    why="who takes off needs charge for the list; who flies comes down first at the check's red",
)
FEED_HZ = Thresholds(
    "poses of the tracker in a second, fewer",
    check=Bounds(8.0, 15.0),
    guardian=Bounds(4.0, 8.0),
    why="30 are sent, an ArduCopter needs 10",
)
POSITION_HZ = Thresholds(
    "positions of the autopilot in a second, fewer", check=Bounds(5.0, 15.0), why="30 are asked for"
)
RADIO_HZ = Thresholds(
    "poses of a vehicle that arrive in a second, fewer", fleet=Bounds(3.0, 10.0), why="30 are sent"
)
PICTURE_HZ = Thresholds("pictures in a second, fewer", check=Bounds(0.0, 0.5))
APART_M = Thresholds(
    "m between estimate and feed on the ground, over", check=Bounds(0.5, 0.2), guardian=Bounds(0.5)
)
APART_IN_FLIGHT_M = Thresholds(
    "m between estimate and feed in flight, over",
    check=Bounds(1.0, 0.5),
    guardian=Bounds(1.0),
    link=Bounds(0.5),
    why="the estimate is later than the feed: the link allows for the speed, the others do not; "
    "the guardian asks before it flies home",
)
EKF_VARIANCE = Thresholds(
    "largest variance of the autopilot's filter, over",
    check=Bounds(0.8, 0.5),
    guardian=Bounds(0.8),
    why="0.8 is ArduCopter's own FS_EKF_THRESH",
)
CONFIDENCE = Thresholds(
    "confidence of the tracking camera (0 to 3), at or below",
    check=Bounds(1.0),
    guardian=Bounds(1.0),
)
TILT_DEG = Thresholds("degrees of tilt, over", guardian=Bounds(50.0, 30.0))
STICK = Thresholds("throttle stick off its middle (0 to 1), over", guardian=Bounds(0.25))
DISK_MIB = Thresholds(
    "MiB free where the recorder writes, below",
    check=Bounds(1000.0, 8000.0),
    fleet=Bounds(1000.0, 2000.0),
    recorder=Bounds(500.0),
    why="the control PC records no pictures; the recorder stops",
)
CLOCK_S = Thresholds(
    "s between a vehicle's clock and the control PC's, over",
    fleet=Bounds(0.5, 0.02),
    calibration=Bounds(0.02),
    why="at 1 m/s of sway 0.02 s are 2 cm of calibration",
)

# ---- how old the newest word of somebody may be (s) ----------------------------------------------

POSE_AGE_S = Thresholds(
    "s without a pose of the tracker, over",
    check=Bounds(0.5),
    guardian=Bounds(0.7, 0.5),
    link=Bounds(0.8, 0.5),
    mission=Bounds(2.0),
    tello=Bounds(3.0, 0.8),
    why="the flight link is the guardian's second line; over the radio poses get lost; a Tello "
    "holds by its own flow sensor meanwhile",
)
OTHER_AGE_S = Thresholds(
    "s without word of another vehicle, over",
    guardian=Bounds(60.0, 1.5),
    why="one that was above may come down then; after a minute its place says nothing",
)
OFTEN_AGE_S = Thresholds(
    "s without what comes at least twice a second, over",
    check=Bounds(2.0),
    fleet=Bounds(3.0),
    console=Bounds(1.0),
    why="radio: one may get lost; an operator sees it sooner than anybody acts",
)
SLOW_AGE_S = Thresholds(
    "s without what comes once a second, over",
    check=Bounds(5.0),
    fleet=Bounds(5.0),
    console=Bounds(2.5),
    why="as above",
)
STATE_AGE_S = Thresholds(
    "s without the autopilot's state, over",
    mission=Bounds(3.5),
    stop_all=Bounds(3.0),
    why="it comes with the heartbeat, once a second, and one may be lost on the radio; "
    "stop-all asks who is silent again, which costs nothing",
)
BATTERY_AGE_S = Thresholds(
    "s without word of the battery, over",
    check=Bounds(5.0),
    guardian=Bounds(10.0),
    mission=Bounds(10.0),
    why="in flight an old share is better than none; the mission counts before the last state",
)
RECORDER_AGE_S = Thresholds(
    "s without word of a recorder, over", check=Bounds(5.0), fleet=Bounds(5.0), mission=Bounds(5.0)
)
GUARDIAN_AGE_S = Thresholds(
    "s without word of the guardian, over",
    check=Bounds(2.0),
    agent=Bounds(2.0),
    mission=Bounds(3.0),
    why="it speaks five times a second; the mission hears it by radio",
)
AGENT_AGE_S = Thresholds(
    "s without word of the agent, over",
    check=Bounds(2.0),
    guardian=Bounds(15.0, 1.0),
    why="it speaks five times a second; aloft a hold waits for it to be started again",
)
LINK_AGE_S = Thresholds(
    "s without word of the flight link, over",
    check=Bounds(2.0),
    guardian=Bounds(2.0),
    tello=Bounds(10.0, 1.5),
    why="a Tello's link is its Wi-Fi",
)
CONTROL_AGE_S = Thresholds("s without word of the control PC, over", guardian=Bounds(30.0, 2.0))
MISSION_AGE_S = Thresholds(
    "s without word of the mission, over", fleet=Bounds(3.0), console=Bounds(3.0)
)
CLOCK_AGE_S = Thresholds(
    "s without an answer about its clock, over", fleet=Bounds(10.0), console=Bounds(10.0)
)
DIAGNOSED_AGE_S = Thresholds(
    "s without a vehicle's diagnostics, over",
    console=Bounds(12.0),
    why="they come every 5 s while all is well, and two may get lost",
)
TRANSMITTER_AGE_S = Thresholds(
    "s without the pilot's transmitter, over", check=Bounds(2.0), guardian=Bounds(2.0)
)
