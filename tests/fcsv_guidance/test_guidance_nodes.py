# SPDX-License-Identifier: Apache-2.0
"""The nodes of guidance on a master: grids and routes to others, a robot driven by cmd_vel, one
with move_base."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from support.waiting import within

from fcsv_geometry import transforms

pytestmark = pytest.mark.ros
until = within(30.0)
CONFIG = Path(__file__).parents[2] / "config"
BOX = (13.0, 14.0, -2.0, 1.0, 0.0, 0.6)
THING = (13.0, 14.0, 2.0, 5.0, 0.0, 0.8)
GROUND = {"cell_m": 0.1, "area_m": [5.0, 22.0, -6.0, 6.0]}
PLACE = {"source": "pose_with_covariance"}


class SimulatedRobot:
    """Does what cmd_vel says, exactly, and publishes where it is at 20 Hz; ``silent``: it does
    not."""

    def __init__(self, x_m, y_m):
        import rospy
        from geometry_msgs.msg import PoseWithCovarianceStamped, Twist

        self.at, self.twist, self.count, self.silent, self.heard_s = (
            [x_m, y_m, 0.0],
            Twist(),
            0,
            False,
            0.0,
        )
        self.pose = rospy.Publisher("/robot_pose", PoseWithCovarianceStamped, queue_size=1)
        self.heard = rospy.Subscriber(
            "/cmd_vel", Twist, self.on_twist, queue_size=1, tcp_nodelay=True
        )
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def on_twist(self, message):
        self.twist, self.count, self.heard_s = message, self.count + 1, time.monotonic()

    def run(self):
        from geometry_msgs.msg import PoseWithCovarianceStamped

        from fcsv_geometry.ros import conversions

        before_s = time.monotonic()
        while not self.over.wait(0.05):
            now_s = time.monotonic()
            dt, before_s = now_s - before_s, now_s
            alive = now_s - self.heard_s < 0.3  # its own watchdog
            v, w = (self.twist.linear.x, self.twist.angular.z) if alive else (0.0, 0.0)
            x, y, yaw = self.at
            middle = yaw + 0.5 * w * dt
            self.at = [x + v * np.cos(middle) * dt, y + v * np.sin(middle) * dt, yaw + w * dt]
            message = PoseWithCovarianceStamped(header=conversions.header(time.time(), "home"))
            message.pose.pose = conversions.transform_to_pose(
                transforms.from_xyz_yaw([*self.at[:2], 0.0], self.at[2])
            )
            message.pose.covariance[0] = message.pose.covariance[7] = 0.02**2
            if not self.silent:
                self.pose.publish(message)

    def stands(self):
        return self.twist.linear.x == 0.0 and self.twist.angular.z == 0.0

    def close(self):
        self.over.set()
        self.thread.join()
        self.heard.unregister()
        self.pose.unregister()


class Heard:
    """The newest message of each topic."""

    def __init__(self, **topics):
        import rospy

        self.all = {name: [] for name in topics}
        self.subscribers = [
            rospy.Subscriber(f"/ground/{name}", kind, self.all[name].append, queue_size=20)
            for name, kind in topics.items()
        ]

    def __call__(self, name):
        return self.all[name][-1] if self.all[name] else None

    def close(self):
        for each in self.subscribers:
            each.unregister()


@pytest.fixture
def heard(ros_master):
    from map_msgs.msg import OccupancyGridUpdate
    from nav_msgs.msg import GridCells, OccupancyGrid, Path
    from std_msgs.msg import String

    made = Heard(
        map=OccupancyGrid,
        stand=OccupancyGrid,
        map_updates=OccupancyGridUpdate,
        path=Path,
        to_see=GridCells,
        status=String,
    )
    yield made
    made.close()


@pytest.fixture
def robot(ros_master):
    made = SimulatedRobot(10.0, 3.0)
    yield made
    made.close()


@pytest.fixture
def ground(start_node, root, scene, write_map, tmp_path):
    """ground(**parameters): the node ground_map in /ground over a map with a box."""

    def start(views=None, **parameters):
        folders = []
        for k, view in enumerate([scene([BOX]).view()] if views is None else views):
            if not (tmp_path / f"map{k}").exists():  # else it is started again
                write_map(view, tmp_path / f"map{k}", stamp_s=time.time())
            folders.append(str(tmp_path / f"map{k}"))
        params = {
            "maps": folders,
            "robot": str(root / "config/robots/rescue.yaml"),
            "ground": GROUND,
            "place": PLACE,
        }
        remaps = {"robot_pose": "/robot_pose"}
        return start_node(
            "fcsv_guidance",
            "ground_map",
            ns="/ground",
            params={**params, **parameters},
            remaps=remaps,
        )

    return start


def go_to(x_m, y_m, frame="home"):
    """Publishes a goal as rviz does."""
    import rospy
    from geometry_msgs.msg import PoseStamped

    from fcsv_geometry.ros import conversions

    goal = rospy.Publisher("/ground/move_base_simple/goal", PoseStamped, queue_size=1)
    until(goal.get_num_connections, what="who takes goals")
    goal.publish(
        conversions.pose_stamped(transforms.from_xyz_yaw([x_m, y_m, 0.0], 0.0), time.time(), frame)
    )
    time.sleep(0.3)
    goal.unregister()


def plan(start, goal, tolerance=0.0, frame="home"):
    """The points of a plan that the service gives."""
    import rospy
    from nav_msgs.srv import GetPlan

    from fcsv_geometry.ros import conversions

    rospy.wait_for_service("/ground/make_plan", 30.0)
    poses = [
        conversions.pose_stamped(transforms.from_xyz_yaw([*p, 0.0], 0.0), 0.0, frame)
        for p in (start, goal)
    ]
    found = rospy.ServiceProxy("/ground/make_plan", GetPlan)(*poses, tolerance).plan
    return np.array([(p.pose.position.x, p.pose.position.y) for p in found.poses])


def test_grids_plans_and_goals(ground, heard, robot, ros_master):
    import rospy

    process = ground()
    until(lambda: heard("map") and heard("stand"), what="both grids")
    said = heard("map")
    assert (said.info.width, said.info.height, said.header.frame_id) == (170, 120, "home")
    assert said.info.resolution == pytest.approx(
        0.1
    ) and said.info.origin.position.x == pytest.approx(5.0)
    grid = np.array(said.data).reshape(120, 170)
    # the box's face, free, hidden
    assert grid[55, 80] >= 50 and 0 <= grid[90, 50] <= 2 and grid[55, 96] == -1
    late = ros_master.run(["rostopic", "echo", "-n1", "--noarr", "/ground/map"], "late")
    until(lambda: late.returncode is not None, what="the grid, for who comes later")
    assert late.returncode == 0 and "length: 20400" in late.tail(20)

    points = plan((10.0, 0.0), (18.0, 0.0))
    assert np.hypot(*np.diff(points, axis=0).T).max() <= 0.21 and np.allclose(
        points[[0, -1]], [(10, 0), (18, 0)]
    )
    inside = (
        (points[:, 0] > 12.6) & (points[:, 0] < 14.4) & (points[:, 1] > -2.4) & (points[:, 1] < 1.4)
    )
    assert not inside.any()
    until(lambda: heard("status"), what="the status")
    for start, goal, frame, words in [
        ((10.0, 0.0), (13.05, -0.5), "home", "at an obstacle"),
        ((10.0, 0.0), (60.0, 0.0), "home", "outside of what was mapped"),
        ((10.0, 0.0), (18.0, 0.0), "odom", "is in frame 'odom', not in home"),
    ]:
        with pytest.raises(rospy.ServiceException, match=words):
            plan(start, goal, frame=frame)
    for tolerance in (np.nan, -5.0):
        with pytest.raises(rospy.ServiceException, match="the tolerance .* is none"):
            plan((10.0, 0.0), (18.0, 0.0), tolerance=tolerance)
    assert heard("status").data == "a map is here; no goal was given" and not heard("path").poses
    assert len(plan((10.0, 0.0), (12.9, 0.0), tolerance=1.5)) > 5

    until(lambda: robot.pose.get_num_connections(), what="the node at the robot's place")
    go_to(18.0, 0.0)
    until(lambda: heard("path") and heard("path").poses, what="a path")
    assert (
        np.hypot(
            heard("path").poses[0].pose.position.x - 10, heard("path").poses[0].pose.position.y - 3
        )
        < 0.1
    )
    go_to(13.05, -0.5)
    until(lambda: not heard("path").poses, what="no path")
    assert "at an obstacle" in heard("status").data
    assert process.returncode is None


def test_cells_that_would_have_to_be_seen_are_told(ground, heard, robot, scene):
    import rospy

    ground([scene(blank=[(13, 15, -9, 9)]).view()])
    until(lambda: heard("map"), what="the map")
    until(lambda: robot.pose.get_num_connections(), what="the node at the robot's place")
    until(lambda: heard("path"), what="the path of its start")
    before = heard("path")
    with pytest.raises(rospy.ServiceException, match="no safe route is known"):
        plan((10.0, 0.0), (18.0, 0.0))
    assert heard("path") is before, "an empty one stops who drives"
    time.sleep(0.2)
    go_to(18.0, 0.0)
    until(lambda: heard("to_see") and heard("to_see").cells, what="cells")
    x = [cell.x for cell in heard("to_see").cells]
    assert 12 < min(x) and max(x) < 16 and heard("to_see").cell_width == pytest.approx(0.1)
    assert "no safe route is known" in heard("status").data and "look at (1" in heard("status").data


def publish_live(view, stamp_s):
    """A live map's topics, as fcsv_stereo's MapTopics names them; publishers to be kept."""
    import rospy
    import tf2_ros

    from fcsv_geometry.camera import PinholeCamera
    from fcsv_geometry.ros import conversions
    from fcsv_stereo.ros.map_messages import REFERENCE_FRAME, depth_message

    latched = {"queue_size": 1, "latch": True}
    kind = conversions.array_to_image(view.kind, "mono8", stamp_s, REFERENCE_FRAME)
    height, width = view.depth.shape
    K = view.K
    camera = PinholeCamera(width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    sent = {
        "depth": depth_message(view.depth, stamp_s),
        "sigma": depth_message(view.sigma, stamp_s),
        "kind": kind,
        "camera_info": conversions.info_from_camera(camera, stamp_s, REFERENCE_FRAME),
    }
    publishers = []
    for name, message in sent.items():
        publishers.append(rospy.Publisher(f"/map/{name}", type(message), **latched))
        publishers[-1].publish(message)
    static = tf2_ros.StaticTransformBroadcaster()
    static.sendTransform(
        [conversions.transform_stamped(view.T_home_cam, stamp_s, "home", REFERENCE_FRAME)]
    )
    return [*publishers, static.pub_tf]


def test_a_live_map_changes_the_grid_and_the_path(ground, heard, robot, scene):
    ground(live=True)
    until(lambda: heard("map"), what="the map")
    until(lambda: robot.pose.get_num_connections(), what="the node at the robot's place")
    time.sleep(0.2)
    go_to(18.0, 3.0)
    until(lambda: heard("path") and heard("path").poses, what="a path")
    straight = len(heard("path").poses)
    shown_s = time.monotonic()
    publishers = publish_live(scene([BOX, THING]).view(), time.time())
    until(lambda: heard("map_updates"), what="an update")
    until(lambda: len(heard("path").poses) > straight + 3, what="a longer path")
    print(f"from the live map to the new path: {time.monotonic() - shown_s:.2f} s")
    update = heard("map_updates")
    assert len(update.data) == update.width * update.height < 170 * 120
    assert update.x + update.width <= 170 and update.y + update.height <= 120
    for publisher in publishers:
        publisher.unregister()


def test_a_robot_with_cmd_vel_drives_to_the_goal_and_stands_for_every_doubt(
    ground, heard, robot, start_node, root
):
    import rospy
    from std_msgs.msg import String

    guides = ground()
    params = {"robot": str(root / "config/robots/rescue.yaml"), "place": PLACE}
    remaps = {"robot_pose": "/robot_pose", "cmd_vel": "/cmd_vel"}
    start_node("fcsv_guidance", "route_follower", ns="/ground", params=params, remaps=remaps)
    until(
        lambda: robot.count > 5 and robot.pose.get_num_connections() >= 2 and heard("map"),
        what="both nodes",
    )
    assert robot.stands()
    began_s, count = time.monotonic(), robot.count
    time.sleep(2.0)
    rate_hz = (robot.count - count) / (time.monotonic() - began_s)
    assert 10 < rate_hz < 25  # 20 Hz on a machine with time
    go_to(15.0, 3.5)
    until(lambda: robot.at[0] > 10.4, what="it drives")

    robot.silent = True
    until(robot.stands, 3.0, "it stands: its place is old")
    robot.silent = False
    until(lambda: robot.twist.linear.x > 0.1, what="it drives on")
    stop = rospy.Publisher("/stop_all", String, queue_size=1)
    until(lambda: stop.get_num_connections() >= 2, what="who hears stop_all")
    stop.publish(String("test"))
    until(robot.stands, 2.0, "it stands: stop_all")
    x = robot.at[0]
    time.sleep(1.0)
    assert robot.at[0] == x and not heard("path").poses
    stop.unregister()

    go_to(15.0, 3.5)
    until(
        lambda: np.hypot(robot.at[0] - 15.0, robot.at[1] - 3.5) < 0.35 and robot.stands(),
        40.0,
        "the goal",
    )
    go_to(13.05, -0.5)
    until(lambda: "at an obstacle" in heard("status").data, what="no way into the box")
    time.sleep(0.3)
    assert robot.stands()

    go_to(10.0, 3.5)
    until(lambda: not robot.stands(), what="it drives back")
    go_to(15.0, 3.5, frame="map")
    until(lambda: not heard("path").poses, what="nobody wants the goal before any more")
    assert "in frame 'map'" in heard("status").data
    until(robot.stands, what="it stands")
    go_to(10.0, 3.5)
    until(lambda: not robot.stands(), what="it drives back")
    guides.kill()
    hold = rospy.Publisher("/ground/hold", String, queue_size=1, latch=True)
    hold.publish(String("something moves"))
    until(robot.stands, what="what the last ground_map said before it died")
    x = robot.at[0]
    ground()
    until(lambda: not heard("path").poses, 20.0, "a ground_map that starts has no goal")
    time.sleep(1.0)
    assert robot.stands() and robot.at[0] == x
    hold.unregister()
    go_to(15.0 if robot.at[0] < 12.5 else 10.0, 3.5)
    until(lambda: not robot.stands(), what="a goal that is given again")


def test_an_old_map_stands_and_says_what_to_do(
    heard, robot, start_node, root, scene, write_map, tmp_path
):
    from std_msgs.msg import String

    write_map(scene([BOX]).view(), tmp_path / "map", stamp_s=time.time() - 3600.0)
    params = {"robot": str(root / "config/robots/rescue.yaml"), "place": PLACE}
    remaps = {"robot_pose": "/robot_pose", "cmd_vel": "/cmd_vel"}
    mapped = {**params, "maps": [str(tmp_path / "map")], "ground": GROUND}
    start_node("fcsv_guidance", "ground_map", ns="/ground", params=mapped, remaps=remaps)
    start_node("fcsv_guidance", "route_follower", ns="/ground", params=params, remaps=remaps)
    said = Heard(**{"follower/status": String})
    until(
        lambda: robot.count > 5 and robot.pose.get_num_connections() >= 2 and heard("map"),
        what="both nodes",
    )
    go_to(15.0, 3.5)
    until(
        lambda: (
            said("follower/status")
            and "s ago, oldest_map_s allows 60 s" in said("follower/status").data
        ),
        what="what is wrong",
    )
    assert robot.stands()
    said.close()


class MoveBase:
    """Stands in for a robot's move_base: it jumps to each goal, or gives up."""

    def __init__(self, robot):
        import actionlib
        from move_base_msgs.msg import MoveBaseAction

        self.robot, self.goals, self.gives_up, self.waits = robot, [], False, False
        self.server = actionlib.SimpleActionServer(
            "/robot/move_base", MoveBaseAction, self.on_goal, auto_start=False
        )
        self.server.start()

    def on_goal(self, goal):
        at = goal.target_pose.pose.position
        self.goals.append((goal.target_pose.header.frame_id, at.x, at.y))
        while self.waits and not self.server.is_preempt_requested():
            time.sleep(0.02)
        if self.server.is_preempt_requested():
            self.server.set_preempted()
        elif self.gives_up:
            self.server.set_aborted(text="no plan to it")
        else:
            self.robot.at = [at.x, at.y, 0.0]
            self.server.set_succeeded()


def test_a_robot_with_move_base_is_given_goals_along_the_route(ground, heard, robot, start_node):
    import rospy
    from std_msgs.msg import String

    base = MoveBase(robot)
    ground()

    def start():
        params = {"place": PLACE, "action": "/robot/move_base"}
        remaps = {"robot_pose": "/robot_pose"}
        return start_node(
            "fcsv_guidance", "move_base_goals", ns="/ground", params=params, remaps=remaps
        )

    gives = start()
    said = Heard(**{"goals/status": String})
    until(
        lambda: said("goals/status") and said("goals/status").data == "no route has come",
        what="the client",
    )
    until(lambda: robot.pose.get_num_connections() >= 2 and heard("map"), what="both nodes")
    time.sleep(0.2)
    go_to(18.0, 0.0)
    until(lambda: said("goals/status").data == "the goal is reached", what="the goal")
    assert len(base.goals) >= 2 and {frame for frame, _, _ in base.goals} == {"home"}
    assert np.allclose(base.goals[-1][1:], (18.0, 0.0), atol=0.01)

    base.waits, count = True, len(base.goals)
    go_to(10.0, 3.0)
    until(lambda: len(base.goals) > count, what="a goal that it works on")
    stop = rospy.Publisher("/stop_all", String, queue_size=1)
    until(lambda: stop.get_num_connections() >= 2, what="who hears stop_all")
    stop.publish(String("test"))
    until(lambda: not base.server.is_active(), 5.0, "the goal is cancelled")
    until(lambda: "stopped by the operator" in said("goals/status").data, what="why")
    stop.unregister()

    go_to(10.0, 3.0)
    until(base.server.is_active, what="a goal that it works on")
    gives.kill()
    start()
    until(lambda: not base.server.is_active(), 8.0, "who died gave it")

    base.waits, base.gives_up = False, True
    go_to(10.0, 3.0)
    until(
        lambda: "move_base gave up (no plan to it)" in said("goals/status").data,
        what="that it gave up",
    )
    said.close()


def test_a_robot_is_located_by_the_vehicles_that_its_gimbals_see(ros_master, start_node):
    """Home is set while it stands; it drives 1 m by its wheels and sees one vehicle that holds."""
    import rospy
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry
    from std_msgs.msg import String

    from fcsv_geometry import transforms
    from fcsv_geometry.ros import conversions
    from fcsv_guidance.place.tracker import WheelOdometry
    from fcsv_guidance.ros import ground_messages as messages
    from fcsv_msgs.msg import Home

    files = {
        "vehicles_dir": str(CONFIG / "vehicles"),
        "robot_file": str(CONFIG / "gimbal" / "ground_robot.yaml"),
    }
    start_node("fcsv_guidance", "cooperative_place", params={"vehicles": ["tello1"], **files})
    poses, words = [], []
    heard = [
        rospy.Subscriber("/robot_pose", PoseWithCovarianceStamped, poses.append, queue_size=50),
        rospy.Subscriber("/place/status", String, words.append, queue_size=50),
    ]
    wheels, seen, own = (
        rospy.Publisher(topic, Odometry, queue_size=5)
        for topic in ("/odom", "/tello1/gimbal/body", "/tello1/tello/odom")
    )
    home = rospy.Publisher("/home", Home, queue_size=1, latch=True)
    until(lambda: all(p.get_num_connections() for p in (wheels, seen, own, home)), what="the node")
    until(lambda: words, what="what is missing")
    assert "set home" in words[0].data
    # home: 2 m before the robot, looking to its left
    T_robot_home = transforms.from_xyz_yaw([2.0, 0.0, 1.5], np.pi / 2)

    def odometry(publisher, T, frame, child, covariance=None):
        message = Odometry(header=conversions.header(time.time(), frame), child_frame_id=child)
        message.pose.pose = conversions.transform_to_pose(T)
        if covariance is not None:
            message.pose.covariance = covariance.ravel().tolist()
        publisher.publish(message)

    def turn(x_m):
        now = WheelOdometry(time.time(), x_m, 0.0, 0.0)
        wheels.publish(messages.odometry_message(now, "robot/odom", "robot/base_link"))
        T = transforms.from_xyz_yaw([3.0 - x_m, 0.5, 1.6], 0.2)
        odometry(seen, T, "tello1/odom", "tello1/base_link", np.eye(6) * 1e-4)
        odometry(own, np.eye(4), "tello1/own", "tello1/base_link")
        time.sleep(0.05)

    home.publish(
        Home(
            conversions.header(time.time(), "tello1/odom"),
            "tello1",
            conversions.transform_to_pose(T_robot_home),
        )
    )
    until(lambda: turn(0.0) or poses, what="a pose")
    at = poses[-1].pose.pose.position
    assert poses[-1].header.frame_id == "home" and abs(at.x) < 0.05 and abs(at.y - 2.0) < 0.05
    for k in range(21):
        turn(0.05 * k)
    until(lambda: poses[-1].pose.pose.position.y < 1.1, what="the way of the wheels")
    at, spread = poses[-1].pose.pose.position, poses[-1].pose.covariance
    assert abs(at.x) < 0.1 and abs(at.y - 1.0) < 0.1 and 0.0 < spread[0] == spread[7] < 0.1**2
    seen.publish(Odometry())  # no pose: dropped and said, nothing is lost
    until(lambda: turn(1.0) or len(poses) > 40, what="that it goes on")
    for each in heard:
        each.unregister()


def test_fixes_and_wheels_become_one_pose(ros_master, start_node):
    """The robot stands, then drives 2 m by its wheels without a fix; a fix elsewhere is refused."""
    import rospy
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry
    from std_msgs.msg import String

    from fcsv_guidance.place.tracker import PlaceFix, WheelOdometry
    from fcsv_guidance.ros import ground_messages as messages

    start_node("fcsv_guidance", "robot_place")
    poses, words = [], []
    heard = [
        rospy.Subscriber("/robot_pose", PoseWithCovarianceStamped, poses.append, queue_size=50),
        rospy.Subscriber("/place/status", String, words.append, queue_size=50),
    ]
    fixes = rospy.Publisher("/robot_fix", PoseWithCovarianceStamped, queue_size=5)
    wheels = rospy.Publisher("/odom", Odometry, queue_size=5)
    until(lambda: fixes.get_num_connections() and wheels.get_num_connections(), what="the node")
    covariance = np.diag([0.02**2, 0.02**2, 0.02**2])

    def turn(x_m, fix=None):
        odometry = WheelOdometry(time.time(), x_m, 0.0, 0.0)
        wheels.publish(messages.odometry_message(odometry, "robot/odom", "robot/base_link"))
        if fix is not None:
            time.sleep(0.02)
            fixes.publish(messages.fix_message(PlaceFix(time.time(), *fix, covariance)))
        time.sleep(0.05)

    until(lambda: turn(0.0) or words, what="what is missing")
    assert "no fix has come" in words[0].data
    until(lambda: turn(0.0, (5.0, 1.0, np.pi / 2)) or poses, what="a pose")
    for k in range(21):
        turn(0.1 * k)
    until(lambda: poses[-1].pose.pose.position.y > 2.9, what="the way of the wheels")
    at, spread = poses[-1].pose.pose.position, poses[-1].pose.covariance
    assert abs(at.x - 5.0) < 0.1 and abs(at.y - 3.0) < 0.1
    assert poses[-1].header.frame_id == "home" and 0.0 < spread[0] == spread[7] < 0.2**2
    for _ in range(8):
        turn(2.0, (15.0, 1.0, np.pi / 2))
    until(lambda: turn(2.0) or "contradict" in words[-1].data, what="that fixes contradict")
    for each in heard:
        each.unregister()


@pytest.mark.parametrize(
    "node_name, params, words",
    [
        ("ground_map", {"robot": "no.yaml", "maps": ["x"]}, "no.yaml"),
        ("ground_map", {"robot": "no.yaml"}, "maps: is empty"),
        (
            "ground_map",
            {"robot": "no.yaml", "maps": ["x"], "drive": "cmdvel"},
            "drive: 'cmdvel' is none of cmd_vel, move_base, none",
        ),
        (
            "cooperative_place",
            {"vehicles": [], "vehicles_dir": "", "robot_file": ""},
            "vehicles: is empty",
        ),
        (
            "route_follower",
            {"robot": "no.yaml", "place": {"source": "pose"}},
            "sigma_m: is missing",
        ),
        ("route_follower", {"place": PLACE}, "'robot' is missing"),
        ("move_base_goals", {"place": {"source": "gps"}}, "'gps' is not one of"),
    ],
)
def test_wrong_parameters_end_a_node_with_one_line(start_node, node_name, params, words):
    process = start_node("fcsv_guidance", node_name, name=f"wrong_{node_name}", params=params)
    until(lambda: process.returncode is not None, what="its end")
    assert process.returncode == 2 and words in process.tail(10)
