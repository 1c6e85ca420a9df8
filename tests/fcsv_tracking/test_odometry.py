# SPDX-License-Identifier: Apache-2.0
"""The odometry gate, pure; and the node on a master: what reaches the autopilot never jumps."""

import math
import time

import numpy as np
import pytest
from support.waiting import within

from fcsv_geometry import transforms as tf
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_tracking.errors import OdometryRejected
from fcsv_tracking.odometry import BodyOdometry, GateParameters

until = within(20.0)

DT_S = 0.005


@pytest.fixture(scope="module")
def T_body_t265(root):
    return load_vehicles(root / "config" / "vehicles", ["uav1"])["uav1"].T_body_t265


def body_at(t_s):
    """T_odom_body of a gentle flight: 1 m/s, tilting by a few degrees, turning."""
    p = [math.sin(t_s), 0.5 * math.cos(0.7 * t_s), 0.2 * t_s]
    return tf.from_xyz_rpy(p, [0.05 * math.sin(2 * t_s), 0.04 * math.cos(t_s), 0.4 * t_s])


def feed(core, k, T_odom_t265):
    q = tuple(tf.quaternion_xyzw(T_odom_t265))
    return core.add(100.0 + k * DT_S, tuple(T_odom_t265[:3, 3].tolist()), q)


def as_transform(pose):
    return tf.from_xyz_quaternion(pose.p_odom_body, pose.q_odom_body_xyzw)


def fly(core, T_body_t265, first, last, T_jump=None):
    """Largest distance and turn between what comes out and the flight without the jump."""
    off_m = turn_rad = 0.0
    for k in range(first, last):
        raw = (np.eye(4) if T_jump is None else T_jump) @ body_at(k * DT_S) @ T_body_t265
        out = as_transform(feed(core, k, raw))
        off_m = max(off_m, float(np.linalg.norm(out[:3, 3] - body_at(k * DT_S)[:3, 3])))
        turn_rad = max(turn_rad, tf.rotation_angle(out, body_at(k * DT_S)))
    return off_m, turn_rad


def test_body_pose_is_the_t265s_with_its_mounting_taken_off(T_body_t265):
    core = BodyOdometry(T_body_t265)
    off_m, turn_rad = fly(core, T_body_t265, 0, 400)
    assert off_m < 1e-9 and turn_rad < 1e-7  # the same identity, in floats
    assert core.status.passed == 400 and not core.status.jumps and not core.status.rejected


def test_twist_is_that_of_the_bodys_origin(T_body_t265):
    core = BodyOdometry(T_body_t265)
    R, p = T_body_t265[:3, :3], T_body_t265[:3, 3]
    v_body, w_body = np.array([0.4, -0.2, 0.1]), np.array([0.3, -0.5, 0.7])
    v_t265, w_t265 = R.T @ (v_body + np.cross(w_body, p)), R.T @ w_body
    T = body_at(0.0) @ T_body_t265
    pose = core.add(
        1.0, tuple(T[:3, 3]), tuple(tf.quaternion_xyzw(T)), tuple(v_t265), tuple(w_t265)
    )
    assert np.allclose(pose.linear_mps, v_body) and np.allclose(pose.angular_radps, w_body)


@pytest.mark.parametrize(
    "T_jump, turned_deg",
    [
        (tf.from_xyz_yaw([0.0, 0.0, -30.0], 0.0), 0.0),  # the thesis's take-off
        (tf.from_xyz_yaw([0.6, -0.4, 0.2], 0.0), 0.0),
        (tf.from_xyz_yaw([1.0, 2.0, 0.0], np.radians(30.0)), 0.05),
    ],
)
def test_a_jump_is_taken_back(T_body_t265, T_jump, turned_deg):
    core = BodyOdometry(T_body_t265)
    fly(core, T_body_t265, 0, 300)
    off_m, turn_rad = fly(core, T_body_t265, 300, 600, T_jump)
    # left over: one step's error of the predicted velocity and yaw rate, at 200 Hz and a smoothing
    # of 50 ms; a turned frame carries the yaw's remainder over the few metres flown
    assert core.status.jumps == 1 and off_m < 0.01 and math.degrees(turn_rad) < 0.05 + turned_deg
    assert core.status.largest_jump_m == pytest.approx(np.linalg.norm(T_jump[:3, 3]), abs=1.5)


def test_rebasing_survives_a_restart(T_body_t265):
    T_jump = tf.from_xyz_yaw([0.0, 0.0, -30.0], 0.0)
    first = BodyOdometry(T_body_t265)
    fly(first, T_body_t265, 0, 100)
    fly(first, T_body_t265, 100, 200, T_jump)
    second = BodyOdometry(T_body_t265, rebase=first.rebase)
    assert fly(second, T_body_t265, 220, 300, T_jump)[0] < 0.01


def test_fast_flight_is_no_jump(T_body_t265):
    core = BodyOdometry(T_body_t265)
    for k in range(400):  # up to 8 m/s at 10 m/s^2, three samples in ten lost
        if k % 10 < 7:
            t_s = k * DT_S
            feed(
                core,
                k,
                tf.from_xyz_yaw([min(5 * t_s**2, 3.2 + 8 * (t_s - 0.8)), 0, 0], 0.0) @ T_body_t265,
            )
    assert not core.status.jumps


@pytest.mark.parametrize(
    "spoil, reason",
    [
        (lambda p, q, s: ((math.nan, p[1], p[2]), q, s), "not_finite"),
        (lambda p, q, s: (p, (math.nan,) * 4, s), "not_finite"),
        (lambda p, q, s: (p, (0.0, 0.0, 0.0, 0.0), s), "quaternion"),
        (lambda p, q, s: (p, tuple(2 * c for c in q), s), "quaternion"),
        (lambda p, q, s: (p, q, s - 0.1), "stamp"),
        (
            lambda p, q, s: (
                p,
                tuple(tf.quaternion_xyzw(tf.from_xyz_rpy([0, 0, 0], [0.5, 0, 0]))),
                s,
            ),
            "tilt",
        ),
    ],
)
def test_what_is_no_sample_is_rejected_and_counted(T_body_t265, spoil, reason):
    core = BodyOdometry(T_body_t265)
    fly(core, T_body_t265, 0, 50)
    T = body_at(50 * DT_S) @ T_body_t265
    p, q, stamp_s = spoil(tuple(T[:3, 3].tolist()), tuple(tf.quaternion_xyzw(T)), 100.0 + 50 * DT_S)
    with pytest.raises(OdometryRejected) as error:
        core.add(stamp_s, p, q)
    assert error.value.reason == reason and core.status.rejected == {reason: 1}
    assert fly(core, T_body_t265, 51, 100)[0] < 1e-9  # and the next good one passes


def test_a_tracker_that_jumps_without_end_is_withheld(T_body_t265):
    core = BodyOdometry(T_body_t265)
    fly(core, T_body_t265, 0, 50)
    with pytest.raises(OdometryRejected, match="lost"):
        for k in range(50, 100):
            feed(
                core,
                k,
                tf.from_xyz_yaw([5.0 * (k % 2), 0, 0], 0.0) @ body_at(k * DT_S) @ T_body_t265,
            )
    assert core.status.lost


def test_a_clock_set_back_is_followed_after_a_bounded_silence(T_body_t265):
    core = BodyOdometry(T_body_t265, GateParameters(patience_samples=20))
    fly(core, T_body_t265, 0, 50)
    passed = 0
    for k in range(30):
        try:
            feed(core, k - 4000, body_at(50 * DT_S) @ T_body_t265)
            passed += 1
        except OdometryRejected:
            pass
    assert passed == 30 - 19


# ---- epochs: what was calibrated before another one does not hold any more -----------------------


class Sampled:
    """A core that is fed at 200 Hz, by stamps whose clock is ``ahead_s`` of the monotonic one."""

    def __init__(self, T_body_t265):
        self.core, self.T_body_t265, self.k, self.ahead_s = (
            BodyOdometry(T_body_t265),
            T_body_t265,
            0,
            1.7e9,
        )

    def fly(self, seconds, T_jump=None, awake_s=0.0):
        """The largest distance (m) of what comes out from the flight without a jump."""
        off_m = 0.0
        for _ in range(round(seconds / DT_S)):
            self.k += 1
            T = (
                (np.eye(4) if T_jump is None else T_jump)
                @ body_at(self.k * DT_S)
                @ self.T_body_t265
            )
            p, q, at_s = tuple(T[:3, 3].tolist()), tuple(tf.quaternion_xyzw(T)), self.k * DT_S
            try:
                out = self.core.add(at_s + self.ahead_s, p, q, came_s=max(at_s, awake_s))
            except OdometryRejected:
                continue
            off_m = max(off_m, math.dist(out.p_odom_body, body_at(at_s)[:3, 3]))
        return off_m

    def silent(self, seconds):
        self.k += round(seconds / DT_S)


@pytest.mark.parametrize(
    "silent_s, begins", [(0.1, False), (0.45, False), (0.55, True), (5.0, True)]
)
def test_a_gap_of_half_a_second_begins_an_epoch(T_body_t265, silent_s, begins):
    s = Sampled(T_body_t265)
    s.fly(1.0)
    s.silent(silent_s)
    s.fly(1.0)
    assert (s.core.epoch.number > s.core.status.jumps) is begins, (
        "a jump that it hid begins one more"
    )


def test_a_gap_over_which_it_stood_still_begins_an_epoch_too(T_body_t265):
    core = BodyOdometry(T_body_t265)
    p, q = tuple(T_body_t265[:3, 3].tolist()), tuple(tf.quaternion_xyzw(T_body_t265))
    for k in range(100):
        core.add(k * DT_S, p, q, came_s=k * DT_S)
    core.add(1.2, p, q, came_s=1.2)
    assert (core.epoch.number, core.epoch.reason) == (1, "the tracker was silent for 0.7 s")


def test_every_jump_that_is_undone_begins_an_epoch(T_body_t265):
    s = Sampled(T_body_t265)
    s.fly(1.0)
    assert s.core.epoch.number == 0
    s.fly(1.0, tf.from_xyz_yaw([0.0, 0.0, -30.0], 0.0))
    assert s.core.epoch.number == 1 and "the tracker jumped by 30" in s.core.epoch.reason
    s.fly(1.0, tf.from_xyz_yaw([2.0, 0.0, -30.0], 0.0))
    assert s.core.epoch.number == 2


@pytest.mark.parametrize("step_s", [-60.0, -2.0, -0.4, 0.4, 2.0, 60.0])
def test_a_step_of_the_clock_is_no_gap_no_jump_and_no_silence(T_body_t265, step_s):
    s = Sampled(T_body_t265)
    s.fly(1.0)
    s.ahead_s += step_s
    assert s.fly(1.0) < 1e-6  # floats of stamps since 1970: 0.2 us
    assert s.core.epoch.number == 0 and not s.core.status.rejected and not s.core.status.jumps


def test_a_computer_that_stood_still_for_a_second_has_missed_nothing_that_comes_after(T_body_t265):
    """The samples waited and come all at once: their stamps show no gap."""
    s = Sampled(T_body_t265)
    s.fly(1.0)
    s.fly(2.0, awake_s=2.0)
    assert s.core.epoch.number == 0 and not s.core.status.rejected


@pytest.mark.ros
def test_node_never_lets_a_jump_or_a_bad_sample_through(start_node, root, T_body_t265):
    import rospy
    from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
    from nav_msgs.msg import Odometry

    got = {"body": [], "state": [], "vision": []}
    subscribers = [
        rospy.Subscriber("/uav1/odometry/body", Odometry, got["body"].append, queue_size=1000),
        rospy.Subscriber("/uav1/odometry/state", Odometry, got["state"].append, queue_size=1000),
        rospy.Subscriber(
            "/uav1/mavros/vision_pose/pose", PoseStamped, got["vision"].append, queue_size=1000
        ),
    ]
    publisher = rospy.Publisher("/uav1/t265/odom/sample", Odometry, queue_size=200)
    folder = str(root / "config" / "vehicles")
    process = start_node(
        "fcsv_tracking", "odometry", ns="uav1", params={"vehicle": "uav1", "vehicles_dir": folder}
    )
    until(
        lambda: all(each.get_num_connections() for each in (publisher, *subscribers)),
        what=process.tail,
    )
    time.sleep(0.3)
    begin_s = time.time()
    for k in range(600):
        T = body_at(k * DT_S) @ T_body_t265
        T = (tf.from_xyz_yaw([0, 0, -30.0], 0.0) if k >= 300 else np.eye(4)) @ T
        message = Odometry()
        message.header.stamp = rospy.Time.from_sec(begin_s + k * DT_S)
        message.header.frame_id = "uav2/t265_odom_frame" if k == 100 else "uav1/t265_odom_frame"
        message.child_frame_id = "uav1/t265_pose_frame"
        q = [math.nan] * 4 if k == 200 else tf.quaternion_xyzw(T)
        message.pose.pose = Pose(Point(*T[:3, 3]), Quaternion(*q))
        publisher.publish(message)
        time.sleep(max(0.0, begin_s + (k + 1) * DT_S - time.time()))
    until(lambda: len(got["body"]) >= 598, what="all but the two bad ones")
    time.sleep(0.2)  # no more come
    assert len(got["body"]) == 598  # all but the two bad ones
    # 30 Hz over 3 s
    assert 80 <= len(got["state"]) <= 92 and len(got["vision"]) == len(got["state"])
    for message in got["vision"]:
        k = round((message.header.stamp.to_sec() - begin_s) / DT_S)
        p = message.pose.position
        assert message.header.frame_id == "uav1/odom"
        # 30 m jump included
        assert np.linalg.norm(np.array([p.x, p.y, p.z]) - body_at(k * DT_S)[:3, 3]) < 0.02
    assert (got["body"][0].header.frame_id, got["body"][0].child_frame_id) == (
        "uav1/odom",
        "uav1/base_link",
    )
    rospy.delete_param("/uav1/odometry_rebase")  # what the jump left for the node's next start
