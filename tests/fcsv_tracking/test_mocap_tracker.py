# SPDX-License-Identifier: Apache-2.0
"""The mocap tracker on a simulated flight, and what it does with everything that is not a pose."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Slerp
from scipy.stats import chi2

from fcsv_geometry import transforms as tf
from fcsv_sim.sensors.tello_sensors import TelloSample
from fcsv_sim.sensors.v120_duo import V120DuoErrors
from fcsv_sim.trials import mocap_evaluation as evaluation
from fcsv_sim.trials import mocap_flight
from fcsv_sim.trials.mocap_flight import FlightErrors
from fcsv_tracking.errors import HomeRefused, SampleRejected
from fcsv_tracking.mocap.blend import Blend
from fcsv_tracking.mocap.samples import VehicleSample
from fcsv_tracking.mocap.system import MocapSystem
from fcsv_tracking.mocap.tracker import MocapTracker

SEED = 4


@pytest.fixture(scope="module")
def flight():
    """A pair in view, one of them 20 m out of it and back."""
    return evaluation.evaluate(SEED)


def recorded(seconds=16.0, seed=2, errors=None):
    """Messages of vehicle a, which stays in view; and its truth."""
    truths = {"a": evaluation.truths(seed)["a"]}
    messages = []
    for now_s, _, message in mocap_flight.messages(truths, errors or FlightErrors(), seed):
        if now_s > evaluation.START_S + seconds:
            break
        messages.append(message)
    return messages, truths["a"]


@pytest.fixture(scope="module")
def in_view():
    return recorded()


@pytest.fixture(scope="module")
def long_in_view():
    """Long enough to move 0.3 m again after all was lost at 13 s."""
    return recorded(24.0)


def take(tracker, message, now_s=None):
    try:
        mocap_flight.deliver(tracker, message, now_s)
    except SampleRejected:
        return False
    return True


def from_truth(poses, truth):
    """Of each pose the distance (m) from the truth, and the normalised error squared. All at once:
    one by one they took half of these tests' time."""
    t_s = np.clip([p.stamp_s for p in poses], truth.t_s[0], truth.t_s[-1])
    R_world_body = Slerp(truth.t_s, tf.Rotation.from_matrix(truth.R))(t_s).as_matrix()
    p_world_body = np.column_stack([np.interp(t_s, truth.t_s, truth.p[:, i]) for i in range(3)])
    T_M_world = tf.invert(mocap_flight.T_WORLD_MOCAP)
    T_M_D = np.array([p.T_M_D for p in poses])
    turns = T_M_D[:, :3, :3] @ np.swapaxes(T_M_world[:3, :3] @ R_world_body, 1, 2)
    off = T_M_D[:, :3, 3] - tf.apply(T_M_world, p_world_body)
    error = np.concatenate([off, tf.Rotation.from_matrix(turns).as_rotvec()], axis=1)[..., None]
    weighted = np.linalg.solve(np.array([p.covariance for p in poses]), error)
    return np.linalg.norm(off, axis=1), (error * weighted).sum(axis=(1, 2))


def normalised(pose, truth):
    (off_m,), (squared,) = from_truth([pose], truth)
    return off_m, squared


def run(messages, truth, change=lambda m: [m]):
    """The tracker after all messages; every pose on the way is right, or says how wrong it may be.

    The bound on the normalised error: one in a million by chance per pose (41 for six degrees of
    freedom).
    """
    tracker = MocapTracker()
    poses = []
    for message in messages:
        for m in change(message):
            take(tracker, m)
        pose = tracker.pose(message.arrival_s)
        if pose is not None and (not poses or pose.stamp_s > poses[-1].stamp_s):
            poses.append(pose)
    assert not poses or from_truth(poses, truth)[1].max() < chi2.ppf(1 - 1e-6, 6)
    return tracker, poses


def since_start(message):
    return message.arrival_s - evaluation.START_S


# -- a seed of the ten in docs/lab/mocap.md; bounds: their worst (1.2 mm, 0.20 deg, 13.6 mm, 0.15
# deg) and a fifth more


def test_in_view(flight):
    found = evaluation.in_view(flight)
    assert found["rms_m"] < 0.0015 and found["rms_deg"] < 0.24


def test_twenty_metres_out_of_view(flight):
    away = evaluation.at_20_m(flight.records["b"])
    assert away.away_m == pytest.approx(20.0, abs=0.2)
    # odometry's own error, which this seed draws, and half a per cent for heading, level and the
    # start
    assert np.linalg.norm(away.error_m) < away.raw_m + 0.005 * away.away_m
    assert evaluation.normalised(away) < chi2.ppf(0.999, 6)


def test_no_jump_at_re_entry_and_right_again_soon(flight):
    records = flight.records["b"]
    assert evaluation.largest_jump_m(records) < 0.0165
    assert records[-1].settled and np.linalg.norm(records[-1].error_m) < 0.005


def test_level_from_both(flight):
    worst = max(v for t, v in flight.level_deg if t > evaluation.START_S + evaluation.LEVEL_AFTER_S)
    assert worst < 0.18


def test_relative_pose_is_consistent_in_view_and_out_of_it(flight):
    for seen in (True, False):
        values = [r[3] for r in flight.relative if r[0] == seen]
        # one flight's errors are alike throughout: the average over it is as wide as one draw of
        # six
        assert len(values) > 100 and np.mean(values) < chi2.ppf(0.999, 6)


def test_learns_the_delay_of_the_odometry(flight):
    for name, tracker in flight.system.trackers.items():
        # of the simulated link: mean, spread; jitter adds 5 ms on average
        sensors_s = 0.07, 0.015 * 3.5
        delay_s = tracker.filter.state.delay_s
        assert abs(delay_s - sensors_s[0]) < sensors_s[1], name
        assert np.sqrt(tracker.filter.covariance[21, 21]) < 0.005


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_consistent_over_ten_flights():
    """The last pose of each: constant errors of a mounting make poses of one flight alike."""
    values = []
    for seed in range(11, 21):
        messages, truth = recorded(10.0, seed)
        values.append(normalised(run(messages, truth)[1][-1], truth)[1])
    low, high = chi2.ppf([0.025, 0.975], 6 * len(values))
    assert low < sum(values) < high


# -- bad input
# --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "position, quaternion, reason",
    [
        ((np.nan, 0, 0), (0, 0, 0, 1), "not a pose"),
        ((0, np.inf, 0), (0, 0, 0, 1), "not a pose"),
        ((0, 0, 0), (0, 0, 0, 0), "not a pose"),
        ((0, 0, 0), (np.nan, 0, 0, 1), "not a pose"),
        ((0, 0, 0), (0, 0, 0, 2), "not a pose"),
    ],
)
def test_what_is_no_pose_is_rejected_and_counted(position, quaternion, reason):
    tracker = MocapTracker()
    with pytest.raises(SampleRejected) as error:
        tracker.add_mocap(10.0, 10.0, position, quaternion)
    assert error.value.reason == reason and tracker.counts[f"mocap: {reason}"] == 1
    with pytest.raises(SampleRejected):
        tracker.add_vehicle(10.0, 10.0, position, quaternion, (0, 0, 0), (0, 0, 0), (0, 0, 9.8))
    assert tracker.counts[f"odometry: {reason}"] == 1


@pytest.mark.parametrize(
    "field, value, reason",
    [
        ("v", (np.nan, 0, 0), "velocity impossible"),
        ("v", (50, 0, 0), "velocity impossible"),
        ("w", (0, np.inf, 0), "gyro impossible"),
        ("a", (0, 0, 1e4), "accelerometer impossible"),
    ],
)
def test_impossible_motion_is_rejected(field, value, reason):
    given = {"v": (0, 0, 0), "w": (0, 0, 0), "a": (0, 0, 9.8), field: value}
    with pytest.raises(SampleRejected) as error:
        MocapTracker().add_vehicle(
            10.0, 10.0, (0, 0, 0), (0, 0, 0, 1), given["v"], given["w"], given["a"]
        )
    assert error.value.reason == reason


@pytest.mark.parametrize(
    "stamp_s, reason",
    [
        (np.nan, "stamp in the future"),
        (11.0, "stamp in the future"),
        (8.0, "stamp too old"),
        (9.99, "stamp goes back"),
    ],
)
def test_stamps_that_cannot_be(stamp_s, reason):
    tracker = MocapTracker()
    tracker.add_mocap(10.0, 10.0, (1, 0, 0), (0, 0, 0, 1))
    with pytest.raises(SampleRejected) as error:
        tracker.add_mocap(10.01, stamp_s, (1, 0, 0.1), (0, 0, 0, 1))
    assert error.value.reason == reason


def test_a_clock_that_is_set_back_for_good(long_in_view):
    """Ten minutes back in mid-flight: absent for a while, then right again, in the new time."""
    messages, truth = long_in_view
    tracker, last = MocapTracker(), None
    for message in messages:
        back_s = 600.0 if since_start(message) > 8.0 else 0.0
        take(tracker, dataclasses.replace(message, arrival_s=message.arrival_s - back_s))
        last = tracker.pose(message.arrival_s - back_s)
    assert tracker.counts["clock set back"] >= 1 and tracker.counts["anchored"] == 2
    assert normalised(dataclasses.replace(last, stamp_s=last.stamp_s + 600.0), truth)[0] < 0.01


def test_garbage_in_between_changes_nothing(in_view):
    messages, truth = in_view
    clean, _ = run(messages, truth)
    dirty = MocapTracker()
    for k, message in enumerate(messages):
        take(dirty, message)
        if k % 7 == 0 and since_start(message) > 6.0:
            now_s = message.arrival_s
            for p, q in (((np.nan, 0, 0), (0, 0, 0, 1)), ((0, 0, 0), (0, 0, 0, 0))):
                with pytest.raises(SampleRejected):
                    dirty.add_mocap(now_s, now_s, p, q)
            with pytest.raises(SampleRejected):
                dirty.add_mocap(now_s, now_s - 0.5, (1, 2, 3), (0, 0, 0, 1))
    now_s = messages[-1].arrival_s
    assert np.allclose(dirty.pose(now_s).T_M_D, clean.pose(now_s).T_M_D, atol=1e-12)
    assert dirty.counts["mocap: not a pose"] > 500


def test_five_seconds_of_silence_of_all(long_in_view):
    messages, truth = long_in_view

    def silent(m):
        return [] if 8.0 < since_start(m) < 13.0 else [m]

    tracker, poses = run(messages, truth, silent)
    stamps = np.array([p.stamp_s for p in poses]) - evaluation.START_S
    # half a second of coasting; again half a second of agreement before there is a pose
    assert (
        not ((stamps > 8.6) & (stamps < 13.3)).any() and ((stamps > 13.3) & (stamps < 14.3)).any()
    )
    assert tracker.counts["anchored"] == 2


@pytest.fixture(scope="module")
def hovering():
    """As recorded(), of a vehicle that flies 0.6 m aside and then stays where it is: nobody who
    lost it flies it on."""
    places = [(2.0, -0.3, 2.0, 0.0), (2.0, 0.3, 2.0, 3.0), (2.0, 0.3, 2.0, 9.0)]
    truth = mocap_flight.fly(places, np.radians(20.0), 3, evaluation.START_S)
    return [m for _, _, m in mocap_flight.messages({"a": truth}, FlightErrors(), 3)], truth


_HUNG_S = (5.0, 8.0)  # after the start


def hung(afterwards):
    """Nothing is heard while the tracker hangs; ``afterwards`` changes what comes later."""

    def change(m):
        since_s = since_start(m)
        return [m] if since_s < _HUNG_S[0] else [afterwards(m)] if since_s > _HUNG_S[1] else []

    return change


def test_a_tracker_that_hung_finds_a_vehicle_again_that_stays_where_it_is(hovering):
    """Its heading was proven before: no movement has to prove it again."""
    messages, truth = hovering
    tracker, poses = run(messages, truth, hung(lambda m: m))
    stamps = np.array([p.stamp_s for p in poses]) - evaluation.START_S
    assert tracker.counts["anchored"] == 2
    assert not ((stamps > 5.8) & (stamps < 8.3)).any() and ((stamps > 8.3) & (stamps < 9.3)).any()


def turned_over(m):
    T_D_turned = tf.from_xyz_yaw(np.zeros(3), np.pi)
    return m if isinstance(m, TelloSample) else dataclasses.replace(m, T_M_D=m.T_M_D @ T_D_turned)


def another_heading(m):
    if not isinstance(m, TelloSample):
        return m
    T = tf.from_xyz_yaw(np.zeros(3), 0.7)
    return dataclasses.replace(m, T_O_D=T @ m.T_O_D, v_O_mps=T[:3, :3] @ m.v_O_mps)


@pytest.mark.parametrize("afterwards", [turned_over, another_heading])
def test_who_looks_otherwise_after_the_silence_must_move_first(hovering, afterwards):
    """A body recognised the wrong way round; odometry that began anew meanwhile."""
    messages, truth = hovering
    tracker, poses = run(messages, truth, hung(afterwards))
    assert tracker.counts["anchored"] >= 2 and tracker.absent_because
    assert max(p.stamp_s for p in poses) - evaluation.START_S < 5.8


def test_odometry_silent_in_view_the_mocap_carries_on(in_view):
    messages, truth = in_view

    def silent(m):
        return [] if isinstance(m, TelloSample) and 8.0 < since_start(m) < 13.0 else [m]

    tracker, poses = run(messages, truth, silent)
    during = [p for p in poses if 9.0 < p.stamp_s - evaluation.START_S < 12.5]
    assert len(during) > 100 and from_truth(during, truth)[0].max() < 0.01
    assert tracker.counts["anchored"] == 1


def test_odometry_silent_out_of_view_the_pose_is_absent_until_seen_again():
    truths = {"b": evaluation.truths(3)["b"]}
    tracker, last = MocapTracker(), {}
    for now_s, _, message in mocap_flight.messages(truths, FlightErrors(), 3):
        t_s = now_s - evaluation.START_S
        if isinstance(message, TelloSample) and 25.0 < t_s < 30.0:
            continue
        take(tracker, message)
        last[int(t_s)] = tracker.pose(now_s)
    assert last[24] is not None and not last[24].in_view
    assert last[27] is None and last[33] is None  # it may have begun anew: nobody knows
    assert last[58] is not None and last[58].in_view
    assert normalised(last[58], truths["b"])[0] < 0.01


def test_an_old_pose_streamed_while_hidden_is_not_believed():
    truths = {"a": evaluation.truths(5)["a"]}
    tracker, poses = MocapTracker(), []
    hidden = lambda t_s: ("a",) if 18.0 < t_s - evaluation.START_S < 26.0 else ()  # noqa: E731
    for now_s, _, message in mocap_flight.messages(truths, FlightErrors(), 5, hidden):
        take(tracker, message)
        t_s, pose = now_s - evaluation.START_S, tracker.pose(now_s)
        if t_s > 32.0:
            break
        if 19.0 < t_s < 25.9:
            assert tracker.old_pose and not pose.in_view
            poses.append(pose)
    assert from_truth(poses, truths["a"])[1].max() < chi2.ppf(1 - 1e-6, 6)
    assert tracker.counts["mocap: old pose streamed on"] > 1000
    assert pose.in_view and not tracker.old_pose


@pytest.mark.parametrize("seed", [1, 2])
def test_swapped_markers_and_turned_bodies_do_no_harm(seed):
    errors = FlightErrors(
        mocap=dataclasses.replace(V120DuoErrors(), swaps_per_s=1.0, flips_per_s=0.3)
    )
    messages, truth = recorded(30.0, seed, errors)
    wrong = sum(not m.true_pose for m in messages if not isinstance(m, TelloSample))
    assert wrong > 300
    tracker, poses = run(messages, truth)
    assert len(poses) > 300 and poses[-1].stamp_s > evaluation.START_S + 29.5
    sure = [p for p in poses if p.stamp_s > evaluation.START_S + 12.0]
    assert from_truth(sure, truth)[0].max() < 0.05


@pytest.mark.parametrize("seed", [5, 8])
def test_swapped_markers_while_the_odometry_is_silent(seed):
    """Then nothing says at once that the body did not turn: the pose may be absent, never wrong."""
    errors = FlightErrors(
        mocap=dataclasses.replace(V120DuoErrors(), swaps_per_s=1.0, flips_per_s=0.1)
    )
    messages, truth = recorded(30.0, seed, errors)
    random = np.random.default_rng(seed)
    gaps, begins_s = [], 8.0
    while begins_s < 30.0:
        gaps.append((begins_s, begins_s + random.uniform(0.25, 0.8)))
        begins_s += random.uniform(1.0, 2.5)

    def silent(m):
        return (
            []
            if isinstance(m, TelloSample) and any(a < since_start(m) < b for a, b in gaps)
            else [m]
        )

    _, poses = run(messages, truth, silent)
    assert len(poses) > 700


def to_and_fro(leg_s, seed):
    """As recorded(), of a vehicle that flies 0.6 m to and fro from the first message on, at times
    out of view."""
    places = [
        (2.0 + dx, 0.3 * (-1) ** i, 2.0, leg_s) for i, dx in enumerate([0.0, 0.1, -0.1, 0.1] * 3)
    ]
    truth = mocap_flight.fly(places, np.radians(20.0), seed, evaluation.START_S)
    return [m for _, _, m in mocap_flight.messages({"a": truth}, FlightErrors(), seed)], truth


def kept_waiting(messages, longest_s, seed):
    """(now s, message): either stream or both stand still now and then, as in a process that is not
    served."""
    random = np.random.default_rng(seed)
    until_s, delivered, next_s = {}, [], messages[0].arrival_s + 3.0
    for m in messages:
        if m.arrival_s > next_s:
            end_s = next_s + longest_s * random.uniform(0.3, 1.0)
            until_s.update(
                dict.fromkeys(((True,), (False,), (True, False))[random.integers(3)], end_s)
            )
            next_s += random.exponential(1.0)
        delivered.append((max(m.arrival_s, until_s.get(isinstance(m, TelloSample), 0.0)), m))
    return sorted(delivered, key=lambda x: x[0])


@pytest.mark.parametrize("longest_s, seed", [(0.2, 3), (0.4, 4), (0.4, 8)])
def test_messages_that_come_in_bursts(longest_s, seed):
    """A frame that comes a little after the filter went on without it is of its own moment, not of
    now."""
    messages, truth = to_and_fro(2.5, seed)
    tracker, poses = MocapTracker(), []
    for now_s, message in kept_waiting(messages, longest_s, seed):
        take(tracker, message, now_s)
        pose = tracker.pose(now_s)
        if pose is not None and (not poses or pose.stamp_s > poses[-1].stamp_s):
            poses.append(pose)
    assert from_truth(poses, truth)[1].max() < chi2.ppf(1 - 1e-6, 6)
    assert poses[-1].stamp_s > messages[-1].arrival_s - 0.5
    assert tracker.counts["anchored"] == 1 and 0 < tracker.counts["too late"] < 500


@pytest.mark.parametrize("too_late_s, asked_s", [(10.05, 10.15), (10.0, 9.99), (9.95, 9.99)])
def test_a_packet_that_came_too_late_is_not_the_next_one(too_late_s, asked_s):
    """Nor is one of before the newest that the filter took: rate and force lead to the next that it
    will take."""

    def sample(yaw_rad):
        turned = tf.from_xyz_yaw([0.0, 0.0, 1.0], yaw_rad)
        return VehicleSample(0.0, turned, np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 9.8]))

    tracker = MocapTracker()
    tracker._vehicle_s, tracker._imu = 10.0, sample(0.0)
    tracker._coming.extend([(too_late_s, sample(1.0), True), (10.2, sample(0.1), True)])
    rate_radps, _, apart_s = tracker._imu_at(asked_s)
    assert apart_s == pytest.approx(0.2) and rate_radps == pytest.approx([0.0, 0.0, 0.5])


@pytest.mark.parametrize("seed", [2, 3])
def test_begun_in_motion(seed):
    """What is anchored at 0.5 m/s knows its speed at once; else the delay is learned wrong, and the
    place with it."""
    messages, truth = to_and_fro(1.5, seed)
    tracker, poses = MocapTracker(), []
    for message in messages:
        take(tracker, message)
        pose = tracker.pose(message.arrival_s)
        poses += [] if pose is None else [pose]
    # 0.06 where it begins as if it stood
    assert tracker.counts["anchored"] == 1 and from_truth(poses, truth)[0].max() < 0.03


def test_a_body_taken_the_wrong_way_round_from_the_start_has_no_pose(in_view):
    """A yaw ambiguity that stands from the first frame: gravity cannot tell, movement can."""
    messages, truth = in_view
    turned = tf.from_xyz_yaw([0.0, 0.0, 0.0], np.pi)

    def flipped(m):
        if isinstance(m, TelloSample) or since_start(m) > 8.0:
            return [m]
        return [dataclasses.replace(m, T_M_D=m.T_M_D @ turned)]

    tracker, poses = run(messages, truth, flipped)
    assert poses[0].stamp_s - evaluation.START_S > 7.9 and normalised(poses[-1], truth)[0] < 0.01


def test_odometry_that_begins_anew_in_view(in_view):
    messages, truth = in_view
    T_restart = tf.from_xyz_yaw([3.0, -1.0, 0.5], 1.3)

    def restarted(m):
        if not isinstance(m, TelloSample) or since_start(m) < 9.0:
            return [m]
        return [
            dataclasses.replace(m, T_O_D=T_restart @ m.T_O_D, v_O_mps=T_restart[:3, :3] @ m.v_O_mps)
        ]

    tracker, poses = run(messages, truth, restarted)
    after = [p for p in poses if p.stamp_s - evaluation.START_S > 9.5]
    assert tracker.counts["odometry: began anew"] == 1 and tracker.counts["anchored"] == 1
    assert from_truth(after, truth)[0].max() < 0.01


def test_another_vehicles_pose_is_not_taken():
    flown = evaluation.truths(6)
    system = MocapSystem({n: np.eye(4) for n in flown})
    for now_s, name, message in mocap_flight.messages(flown, FlightErrors(), 6):
        t_s = now_s - evaluation.START_S
        if t_s > 16.0:
            break
        if isinstance(message, TelloSample):
            take(evaluation.Named(system, name), message)
        elif name == "b" or t_s < 12.0:
            take(evaluation.Named(system, name), message)
            if name == "b" and t_s > 12.0:  # a's topic shows b
                take(evaluation.Named(system, "a"), message)
    assert system.trackers["a"].counts["mocap: another vehicle's place"] > 100
    for name in "ab":
        pose = system.trackers[name].pose(now_s)
        assert normalised(pose, flown[name])[1] < chi2.ppf(1 - 1e-6, 6)


def test_home_is_refused_with_the_reason(flight):
    system = MocapSystem({"a": np.eye(4)})
    with pytest.raises(HomeRefused, match="has no pose: not seen yet"):
        system.set_home("a", 10.0)


def test_home_is_level_with_the_cameras_heading(flight):
    system, now_s = flight.system, flight.records["a"][-1].stamp_s + 0.1
    T_body_cam = tf.transform(tf.R_FLU_OPTICAL, [0.05, 0.0, 0.0])
    system._T_body_cam = dict.fromkeys(("a", "b"), T_body_cam)
    system.set_home("a", now_s)
    camera = system.camera("a", now_s)
    assert np.allclose(camera.T_home_cam[:3, 3], 0.0, atol=1e-9)
    forward = camera.T_home_cam[:3, 2]
    assert abs(forward[1]) < 1e-9 and forward[0] > 0.9
    T_true = flight.truths["a"].at(camera.stamp_s) @ T_body_cam
    # level 0.2, pose 3 sigma
    assert np.degrees(np.arccos(camera.T_home_cam[2, :3] @ T_true[2, :3])) < 0.6
    pose = system.trackers["a"].pose(now_s)
    assert np.allclose(
        system.T_home_mocap @ pose.T_M_O @ pose.T_O_D @ T_body_cam, camera.T_home_cam
    )
    assert np.linalg.eigvalsh(camera.covariance).min() > 0


def test_blend_follows_at_a_bounded_speed():
    blend, before = Blend(0.3, 0.2), tf.from_xyz_yaw([1.0, 0.0, 0.0], 0.1)
    after = tf.from_xyz_yaw([1.0, 0.4, 0.0], -0.1)
    blend.corrected(before, after)
    assert np.allclose(blend.pose(after), before)
    assert blend.covariance()[1, 1] == pytest.approx(0.16)
    last = blend.pose(after)
    for _ in range(140):
        blend.advance(0.01)
        now = blend.pose(after)
        assert np.linalg.norm(now[:3, 3] - last[:3, 3]) < 0.0031
        last = now
    assert np.allclose(last, after)
