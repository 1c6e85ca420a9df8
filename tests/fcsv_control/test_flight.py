# SPDX-License-Identifier: Apache-2.0
"""The flight link's parts without a socket or a clock: frames, texts, commands, connection, feed,
watchdog."""

import math

import numpy as np
import pytest
from support.autopilots import MUST, PROFILE

from fcsv_control.flight.mavlink import conversion, keeper
from fcsv_control.flight.mavlink.commands import ACCEPTED, FAILED, IN_PROGRESS, PendingCommand
from fcsv_control.flight.mavlink.keeper import ConnectionKeeper
from fcsv_control.flight.mavlink.texts import Reasons, TextJoiner
from fcsv_control.flight.mavlink.timesync import TimeSync
from fcsv_control.flight.pose_feed.feed import PoseGate, PoseGateParameters, PoseVerdict
from fcsv_control.flight.pose_feed.watchdog import Alarm, PoseWatchdog, WatchdogParameters
from fcsv_control.flight.settings.parameters import ParameterCheck
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode

# ---- frames --------------------------------------------------------------------------------------

P_NED_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
R_FLU_FRD = np.diag([1.0, -1.0, -1.0])


@pytest.mark.parametrize(
    "yaw_enu, yaw_ned", [(0.0, 90.0), (90.0, 0.0), (180.0, -90.0), (-90.0, 180.0), (45.0, 45.0)]
)
def test_yaw_by_hand(yaw_enu, yaw_ned):
    """Facing east is 0 in ENU and 90 in NED; north 90 and 0."""
    got = math.degrees(conversion.swap_yaw(math.radians(yaw_enu)))
    assert math.remainder(got - yaw_ned, 360.0) == pytest.approx(0.0, abs=1e-9)


def test_position_by_hand():
    # 1 m east, 2 m north, 3 m up
    assert conversion.swap_ned_enu((1.0, 2.0, 3.0)) == (2.0, 1.0, -3.0)


def test_attitude_is_the_same_rotation_in_the_other_frames():
    """R_ned_frd = P_ned_enu R_enu_flu R_flu_frd, whatever the three angles are called."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        T = transforms.from_xyz_rpy(
            rng.normal(0, 10, 3), rng.uniform([-1, -1.4, -math.pi], [1, 1.4, math.pi])
        )
        ned, rpy = conversion.ned_from_pose(T)
        R_ned_frd = transforms.from_xyz_rpy([0, 0, 0], rpy)[:3, :3]
        assert np.allclose(R_ned_frd, P_NED_ENU @ T[:3, :3] @ R_FLU_FRD, atol=1e-12)
        assert np.allclose(ned, P_NED_ENU @ T[:3, 3])
        assert np.allclose(conversion.pose_from_ned(ned, rpy), T, atol=1e-12)


def test_nose_up_stays_nose_up():
    """Pitch is positive downwards in FLU and positive upwards in FRD."""
    T = transforms.from_xyz_rpy([0, 0, 0], [0.0, -0.2, 0.0])  # nose up
    assert (T @ [1, 0, 0, 1])[2] > 0
    _, (_, pitch_frd, _) = conversion.ned_from_pose(T)
    assert pitch_frd == pytest.approx(0.2)


# ---- texts ---------------------------------------------------------------------------------------


def test_a_short_text_is_whole():
    assert TextJoiner().add(0.0, 2, "Arm: VisOdom: not healthy") == (2, "Arm: VisOdom: not healthy")


def test_chunks_are_joined():
    joiner, text = TextJoiner(), "x" * 50 + "y" * 50 + "end"
    assert joiner.add(0.0, 4, text[:50], 7, 0) is None
    assert joiner.add(0.1, 4, text[50:100], 7, 1) is None
    assert joiner.add(0.2, 4, text[100:], 7, 2) == (4, text)


def test_a_text_of_exactly_two_pieces_ends_with_an_empty_one():
    joiner = TextJoiner()
    joiner.add(0.0, 4, "a" * 50, 7, 0)
    assert joiner.add(0.1, 4, "", 7, 1) == (4, "a" * 50)


def test_two_texts_at_once_stay_apart():
    joiner = TextJoiner()
    joiner.add(0.0, 4, "a" * 50, 1, 0)
    joiner.add(0.0, 2, "b" * 50, 2, 0)
    assert joiner.add(0.0, 2, "B", 2, 1) == (2, "b" * 50 + "B")
    assert joiner.add(0.0, 4, "A", 1, 1) == (4, "a" * 50 + "A")


def test_lost_pieces_leave_marks_and_are_not_waited_for_for_ever():
    joiner = TextJoiner()
    joiner.add(0.0, 4, "a" * 50, 7, 0)
    assert joiner.add(0.1, 4, "end", 7, 2) == (4, "a" * 50 + "..." + "end")
    joiner.add(1.0, 4, "b" * 50, 8, 0)
    assert joiner.overdue(1.5) == []
    assert joiner.overdue(2.1) == [(4, "b" * 50 + "...")]
    assert joiner.overdue(9.0) == []


def test_an_id_that_is_used_again_begins_a_new_text():
    joiner = TextJoiner()
    joiner.add(0.0, 4, "a" * 50, 7, 0)
    assert joiner.add(0.5, 4, "new", 7, 0) == (4, "new")


def test_reasons_are_those_said_since_and_serious():
    reasons = Reasons()
    reasons.add(1.0, 2, "before")
    reasons.add(3.0, 2, "Arm: one")
    reasons.add(3.1, 6, "information")
    reasons.add(3.2, 2, "Arm: two")
    reasons.add(3.3, 2, "Arm: one")
    assert reasons.since(2.0) == "Arm: one; Arm: two"
    assert reasons.since(4.0) == ""


# ---- commands ------------------------------------------------------------------------------------


def test_a_command_is_repeated_with_a_confirmation_number_until_answered():
    pending = PendingCommand(400, 0.0, timeout_s=1.0, tries=3)
    assert pending.due(0.0) == 0 and pending.due(0.5) is None
    assert pending.due(1.0) == 1
    pending.acknowledge(1.2, FAILED)
    assert pending.result == FAILED and pending.over(1.2) and pending.due(5.0) is None
    pending.acknowledge(1.3, ACCEPTED)  # a second answer, to the repetition
    assert pending.result == FAILED


def test_a_command_is_given_up_after_all_tries_and_no_later():
    pending = PendingCommand(400, 0.0, timeout_s=0.6, tries=3)
    sent_s = [
        t for t in np.arange(0.0, 3.0, 0.01) if not pending.over(t) and pending.due(t) is not None
    ]
    assert sent_s == pytest.approx([0.0, 0.6, 1.2], abs=0.02)
    assert not pending.over(sent_s[-1] + 0.59) and pending.over(sent_s[-1] + 0.61)


def test_a_command_is_given_up():
    pending = PendingCommand(400, 0.0, timeout_s=1.0, tries=2)
    assert [pending.due(t) for t in (0.0, 1.0, 2.0)] == [0, 1, None]
    assert not pending.over(1.9) and pending.over(2.0) and pending.result is None


def test_in_progress_is_waited_for():
    pending = PendingCommand(22, 0.0, timeout_s=1.0, tries=1)
    pending.due(0.0)
    pending.acknowledge(0.5, IN_PROGRESS)
    assert not pending.over(3.0) and pending.due(3.0) is None
    pending.acknowledge(4.0, ACCEPTED)
    assert pending.over(4.0) and pending.result == ACCEPTED


def test_an_answer_before_the_question_is_none():
    pending = PendingCommand(400, 0.0, 1.0, 1)
    pending.acknowledge(0.0, ACCEPTED)
    assert pending.result is None


# ---- connection ----------------------------------------------------------------------------------

ONCE = {keeper.STREAMS, keeper.ASK_ORIGIN, keeper.PARAMETER, keeper.VERSION, keeper.TIMESYNC}
ALL_ASKED = {keeper.HEARTBEAT, *ONCE}


def connected_keeper():
    k = ConnectionKeeper(["ATTITUDE"])
    assert k.due(0.0) == [keeper.HEARTBEAT]  # it speaks first
    assert k.heartbeat(0.1, booting=False)
    assert set(k.due(0.1)) == ONCE
    return k


@pytest.mark.parametrize("answered", [True, False])
def test_it_speaks_once_a_second(answered):
    k, beats_s = ConnectionKeeper(["ATTITUDE"]), []
    for now_s in np.arange(0.0, 10.0, 0.01):
        if answered:
            k.heartbeat(now_s, booting=False)
        beats_s += [now_s] * k.due(now_s).count(keeper.HEARTBEAT)
    assert beats_s == pytest.approx(np.arange(10), abs=0.1)


def test_origin_is_asked_for_before_it_is_set_and_set_until_it_is_there():
    k = connected_keeper()
    sent = []
    for t in np.arange(0.2, 2.9, 0.1):
        k.heartbeat(t, booting=False)
        sent += [(round(t, 1), what) for what in k.due(t) if what == keeper.SET_ORIGIN]
    assert [t for t, _ in sent] == pytest.approx([0.6, 1.6, 2.6], abs=0.11)
    k.origin(2.9, lasts=True)
    k.heartbeat(2.9, booting=False)
    assert keeper.SET_ORIGIN not in k.due(5.0)


def test_an_origin_counts_while_it_is_reported_and_is_asked_for_for_ever():
    k = connected_keeper()
    k.origin(0.5, lasts=False)  # reported before the filter had begun
    assert not k.origin_set(0.6)
    k.origin(2.0, lasts=True)
    asked, set_again = [], []
    for t in np.arange(2.0, 12.0, 0.1):
        k.heartbeat(t, booting=False)
        due = k.due(t)
        asked += [t for what in due if what == keeper.ASK_ORIGIN]
        set_again += [t for what in due if what == keeper.SET_ORIGIN]
    assert len(asked) == 10 and k.origin_set(6.9) and not k.origin_set(7.1)
    # it went away: set again
    assert set_again[0] == pytest.approx(2.0 + keeper.ORIGIN_LASTS_S, abs=0.2)


def test_streams_are_asked_for_again_only_when_they_stop():
    k = connected_keeper()
    asked = []
    for t in np.arange(0.2, 12.0, 0.1):
        k.heartbeat(t, booting=False)
        if t < 4.0 or t > 8.0:
            k.stream(t, "ATTITUDE", int(1000 * t))
        if keeper.STREAMS in k.due(t):
            asked.append(t)
            assert k.streams_to_ask(t) == ["ATTITUDE"]
    assert asked == pytest.approx([6.0, 8.0], abs=0.25)


def test_silence_begins_all_anew():
    k = connected_keeper()
    k.origin(0.2, lasts=True)
    k.parameters_read = True
    k.stream(0.2, "ATTITUDE", 5000)
    assert k.connected(3.0) and not k.connected(3.2)
    assert k.due(3.2) == [keeper.HEARTBEAT]
    assert k.heartbeat(4.0, booting=False)
    assert not k.origin_set(4.0) and set(k.due(4.2)) == ALL_ASKED


def test_a_reboot_without_silence_is_noticed():
    k = connected_keeper()
    k.origin(0.2, lasts=True)
    k.parameters_read = True
    assert not k.stream(0.2, "ATTITUDE", 60000)
    assert not k.stream(0.3, "LOCAL_POSITION_NED", 59990)  # sent a little earlier, came later
    k.heartbeat(2.0, booting=False)
    assert k.stream(2.5, "ATTITUDE", 900)
    assert not k.origin_set(2.5) and {keeper.ASK_ORIGIN, keeper.PARAMETER} <= set(k.due(2.6))
    assert not k.stream(2.6, "ATTITUDE", 1000)


def test_parameters_are_read_one_by_one_and_what_is_wrong_is_named():
    check = ParameterCheck(PROFILE)
    answers = dict(PROFILE.values, VISO_TYPE=0.0, EK3_SRC1_POSXY=3.0, BATT_FS_LOW_ACT=0.0)
    answers.update(FS_THR_ENABLE=1.0, RC_OPTIONS=32, BATT_LOW_VOLT=0.0, BATT_CRT_VOLT=13.2)
    # this firmware does not know them: no answer
    del answers["VISO_ORIENT"], answers["FENCE_RADIUS"]
    asked = []
    while (name := check.next()) is not None:
        asked.append(name)
        if name in answers:
            check.answer(name, answers[name])
    assert asked.count("VISO_ORIENT") == 5 and asked.count("VISO_TYPE") == 1
    assert all(PROFILE.rule(name).must for name in asked[: len(MUST)])  # what blocks is known first
    lines = check.problems()
    assert any("VISO_TYPE is 0, not 2 or 3" in line for line in lines)
    assert any("EK3_SRC1_POSXY is 3, not 6" in line for line in lines)
    assert any("VISO_ORIENT" in line and "not answered" in line for line in lines)
    assert any("BATT_FS_LOW_ACT is 0" in line for line in lines) and any(
        "FS_THR_ENABLE is 1" in line for line in lines
    )
    assert len(lines) == 5 and check.complete and not check.known
    assert check.unknown() == ["VISO_ORIENT", "FENCE_RADIUS"]
    check.answer("VISO_TYPE", 2.0)  # corrected meanwhile
    assert not any("VISO_TYPE" in line for line in check.problems())
    assert [line.split(":")[0] for line in check.warnings()] == [
        "BATT_LOW_VOLT is 0, not 1..",
        "RC_OPTIONS is 32, not without bit 5",
    ]


def test_the_clocks_are_compared_by_the_quickest_answer():
    sync = TimeSync()
    assert sync.offset_s is None and sync.round_trip_s is None
    # the autopilot's clock is 100 s ahead; answers take their time
    for k, late_s in enumerate((0.020, 0.004, 0.150)):
        tc1, ts1 = sync.ask(10.0 + k)
        assert tc1 == 0
        assert sync.receive(10.0 + k + late_s, int((110.0 + k + 0.002) * 1e9), ts1) is None
    assert sync.round_trip_s == pytest.approx(0.004) and sync.offset_s == pytest.approx(
        100.0, abs=1e-6
    )
    # somebody else's
    assert sync.receive(13.0, 5, 77) is None and sync.offset_s == pytest.approx(100.0, abs=1e-6)
    assert sync.receive(14.0, 0, 99) == (14_000_000_000, 99)  # the autopilot asks


# ---- feed ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "rate_in, passed", [(200.0, 300), (30.0, 300), (31.0, 300), (60.0, 300), (15.0, 150)]
)
def test_the_feed_passes_thirty_a_second_at_most(rate_in, passed):
    rng = np.random.default_rng(1)
    feed = PoseGate(PoseGateParameters())
    stamps = (
        1000.0
        + np.arange(0.0, 10.0, 1.0 / rate_in)
        + rng.uniform(0, 0.1 / rate_in, int(math.ceil(10.0 * rate_in)))
    )
    assert sum(feed.decide(s + 0.004, s)[0] is PoseVerdict.SEND for s in stamps) == pytest.approx(
        passed, rel=0.02
    )


def dropped(feed, now_s, stamp_s, why):
    verdict, text = feed.decide(now_s, stamp_s)
    return verdict is PoseVerdict.DROP and why in text


def test_the_feed_drops_what_is_no_news():
    feed = PoseGate(PoseGateParameters(stale_s=0.3))
    assert feed.decide(10.0, 9.99)[0] is PoseVerdict.SEND
    assert dropped(feed, 10.02, 9.99, "not newer")
    assert dropped(feed, 11.0, 10.5, "0.49 s older")
    assert feed.decide(11.1, 11.09)[0] is PoseVerdict.SEND


def fed(feed, seconds, here_s, wall_s, late=lambda t: 0.004):
    """Poses at 200 Hz for some time; what was dropped, and the stamps that passed."""
    drops, stamps = [], []
    for k in range(int(seconds * 200)):
        t = k / 200.0
        verdict, why = feed.decide(here_s + t + late(t), wall_s + t)
        if verdict is PoseVerdict.SEND:
            stamps.append(feed.stamp_s)
        elif verdict is PoseVerdict.DROP:
            drops.append(why)
    return drops, stamps


@pytest.mark.parametrize("step_s", [0.4, -0.4, 2.0, -2.0, 60.0, -60.0, 0.05, -0.05])
def test_a_clock_that_is_set_drops_two_poses_at_most_and_the_stamps_go_on_rising(step_s):
    feed = PoseGate(PoseGateParameters())
    _, before = fed(feed, 3.0, 100.0, 1.7e9)
    drops, after = fed(feed, 3.0, 103.0, 1.7e9 + 3.0 + step_s)
    stamps = np.array(before + after)
    # less than 0.1 s is taken for late poses: 50 ms of them
    assert len(drops) <= (2 if abs(step_s) > 0.1 else 10)
    assert np.all(np.diff(stamps) > 0.0) and np.diff(stamps).max() < 0.1
    assert len(after) == pytest.approx(90, abs=3)
    assert stamps[-1] == pytest.approx(106.0, abs=0.1)  # the receiver's clock


def test_a_clock_that_is_set_while_poses_are_held_up_costs_a_tenth_of_a_second():
    feed = PoseGate(PoseGateParameters())
    fed(feed, 1.0, 100.0, 1.7e9)
    drops, stamps = fed(feed, 1.0, 101.4, 1.7e9 + 1.0 - 2.0)
    assert len(drops) <= 0.1 * 200 + 1 and len(stamps) > 25


def test_poses_that_are_held_up_are_dropped_until_they_are_fresh_again():
    """Half a second without any, then all that waited in a burst."""
    feed = PoseGate(PoseGateParameters())
    fed(feed, 1.0, 100.0, 1.7e9)
    drops, stamps = fed(feed, 1.0, 101.0, 1.7e9 + 1.0, late=lambda t: max(0.004, 0.5 - t))
    assert 30 <= len(drops) <= 50 and all("older than fresh ones" in why for why in drops)
    assert stamps and stamps[0] > 101.15


# ---- watchdog ------------------------------------------------------------------------------------


NONE, WARN, LAND = Alarm.NONE, Alarm.WARN, Alarm.LAND


def verdicts(dog, times, armed=True, mode=Mode.GUIDED):
    return [dog.check(t, armed, mode) for t in times]


def test_the_watchdog_warns_then_lands_once_it_is_obeyed():
    dog = PoseWatchdog(WatchdogParameters(), 0.0)
    dog.pose_sent(10.0)
    assert verdicts(dog, [10.4, 10.6, 10.75]) == [NONE, WARN, WARN]
    assert verdicts(dog, [10.85, 10.9, 11.5]) == [LAND, WARN, WARN]
    assert dog.check(11.9, True, Mode.GUIDED) is LAND  # not seen in LAND yet: again
    assert dog.check(12.2, True, Mode.LAND) is NONE
    # the pilot took over: no fight
    assert verdicts(dog, [13.5, 15.0], mode=Mode.LOITER) == [WARN, WARN]
    dog.pose_sent(20.0)
    assert verdicts(dog, [20.1, 20.9]) == [NONE, LAND]  # a second death


def test_the_watchdog_leaves_others_alone():
    dog = PoseWatchdog(WatchdogParameters(), 0.0)
    dog.pose_sent(1.0)
    assert verdicts(dog, [5.0], armed=False) == [NONE]
    assert verdicts(dog, [5.0], mode=Mode.ALT_HOLD) == [NONE] and verdicts(
        dog, [5.0], mode=Mode.STABILIZE
    ) == [NONE]


@pytest.mark.parametrize("mode", [Mode.LOITER, Mode.POSHOLD, Mode.BRAKE, Mode.RTL])
def test_in_a_mode_that_the_pilot_chose_the_watchdog_only_speaks(mode):
    dog = PoseWatchdog(WatchdogParameters(), 0.0)
    dog.pose_sent(1.0)
    assert verdicts(dog, np.arange(1.0, 30.0, 0.1), mode=mode).count(LAND) == 0
    assert verdicts(dog, [30.0], mode=mode) == [WARN]
    assert dog.check(30.1, True, mode, ours=True) is LAND  # one that the companion commanded


def test_time_in_which_nobody_could_watch_is_no_silence():
    dog = PoseWatchdog(WatchdogParameters(), 0.0)
    dog.pose_sent(10.0)
    dog.slept(11.5, 1.4)  # the computer stood still from 10.1 to 11.5
    assert verdicts(dog, [11.5, 12.0, 12.25]) == [NONE, WARN, LAND]
    dog.pose_sent(20.0)
    dog.slept(20.01, 3.0)  # the feed was read first
    assert dog.age_s(20.01) == 0.0


def test_a_feed_that_never_began_is_dead():
    """The link was restarted in flight while the odometry was gone."""
    dog = PoseWatchdog(WatchdogParameters(), 100.0)
    assert verdicts(dog, [100.3, 100.9]) == [NONE, LAND]


def test_the_watchdog_may_be_told_to_warn_only():
    dog = PoseWatchdog(WatchdogParameters(land_s=0.0), 0.0)
    assert verdicts(dog, [0.6, 3.0]) == [WARN, WARN]


@pytest.mark.parametrize(
    "values", [{"warn_s": 0.0}, {"warn_s": 0.5, "land_s": 0.2}, {"land_s": float("nan")}]
)
def test_watchdog_parameters_out_of_range_are_refused(values):
    with pytest.raises(ValueError, match="_s: "):
        WatchdogParameters(**values)
