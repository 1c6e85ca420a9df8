# SPDX-License-Identifier: Apache-2.0
"""Grids, routes and cells as messages, and back."""

from typing import List, Tuple

import numpy as np
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    Twist,
    Vector3,
)
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import GridCells, MapMetaData, OccupancyGrid, Odometry, Path
from std_msgs.msg import Header

from fcsv_geometry import frames, transforms
from fcsv_geometry.messages import seconds
from fcsv_geometry.ros import conversions
from fcsv_guidance.errors import GroundError, PlaceError, RouteError
from fcsv_guidance.grid import Grid
from fcsv_guidance.messages import DriveCommand
from fcsv_guidance.place.cooperative_place import RobotStart, UntrackedOdometry, VehicleSighting
from fcsv_guidance.place.mapped_camera import RefinedCamera
from fcsv_guidance.place.tracker import PlaceFix, PlaceState, WheelOdometry
from fcsv_guidance.route.grid_regions import Region
from fcsv_guidance.route.ground_server import densely
from fcsv_msgs.msg import Home, RefinedCameras

_POSES_APART_M = 0.2
_XY_YAW = (0, 1, 5)  # of x, y, z, roll, pitch, yaw, as ROS orders a covariance


def grid_message(
    grid: Grid, percents: np.ndarray, stamp_s: float, loaded_s: float
) -> OccupancyGrid:
    """``percents`` (rows, columns) int8 in home; ``stamp_s``: of the newest picture in it, -inf where
    none is dated, which is 0 in a message."""
    origin = Pose(Point(grid.x0_m, grid.y0_m, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0))
    info = MapMetaData(
        map_load_time=conversions.header(loaded_s, "").stamp,
        resolution=grid.cell_m,
        width=grid.columns,
        height=grid.rows,
        origin=origin,
    )
    return OccupancyGrid(_seen_header(stamp_s), info, percents.ravel().tolist())


def grid_of(message: OccupancyGrid) -> Tuple[Grid, np.ndarray]:
    """The grid and its percents (rows, columns) int8. Raises GroundError where it is turned, not in
    home, or cut."""
    info, q = message.info, message.info.origin.orientation
    _require_home("a grid", message)
    if not np.isfinite([q.x, q.y, q.z, q.w]).all():
        raise GroundError("the orientation of a grid's origin is not finite")
    if abs(q.x) + abs(q.y) + abs(q.z) > 1e-6:
        raise GroundError(
            "a grid that is turned against home cannot be used; its origin's orientation must be none"
        )
    if len(message.data) != info.width * info.height:
        raise GroundError(
            f"a grid of {info.width} x {info.height} cells has {len(message.data)} values"
        )
    cell_m = float(np.round(info.resolution, 6))  # a float32
    grid = Grid(info.origin.position.x, info.origin.position.y, cell_m, info.height, info.width)
    return grid, np.array(message.data, np.int8).reshape(grid.shape)


def update_message(region: Region, stamp_s: float) -> OccupancyGridUpdate:
    """Makes the message as costmap_2d and rviz take it."""
    rows, columns = region.percents.shape
    header, percents = _seen_header(stamp_s), region.percents.ravel().tolist()
    return OccupancyGridUpdate(header, region.column, region.row, columns, rows, percents)


def region_of(message: OccupancyGridUpdate) -> Region:
    """Raises GroundError where it is not in home, or cut."""
    _require_home("an update of a grid", message)
    if len(message.data) != message.width * message.height:
        raise GroundError(
            f"an update of {message.width} x {message.height} cells has {len(message.data)} values"
        )
    return Region(
        message.y, message.x, np.array(message.data, np.int8).reshape(message.height, message.width)
    )


def _require_home(what: str, message) -> None:
    if message.header.frame_id != frames.HOME:
        raise GroundError(f"{what} in frame '{message.header.frame_id}' is not in {frames.HOME}")


def path_message(points_home_m: np.ndarray, stamp_s: float) -> Path:
    """A pose at least every 0.2 m of (N,2), each turned to the next; none of an empty one."""
    path = Path(header=conversions.header(stamp_s, frames.HOME))
    if not len(points_home_m):
        return path
    points = densely(np.asarray(points_home_m, float), _POSES_APART_M)
    ahead = np.diff(points, axis=0)
    yaws = np.arctan2(ahead[:, 1], ahead[:, 0])
    for (x, y), yaw in zip(points, [*yaws, yaws[-1] if len(yaws) else 0.0]):
        path.poses.append(
            conversions.pose_stamped(
                transforms.from_xyz_yaw([x, y, 0.0], yaw), stamp_s, frames.HOME
            )
        )
    return path


def route_of(path: Path) -> np.ndarray:
    """(N,2) home. Raises RouteError where it is not in home; a pose without a frame is in the
    path's."""
    if path.poses and path.header.frame_id != frames.HOME:
        raise RouteError(f"a path in frame '{path.header.frame_id}' is not in {frames.HOME}")
    for frame in {p.header.frame_id for p in path.poses} - {"", frames.HOME}:
        raise RouteError(f"a path with a pose in frame '{frame}' is not in {frames.HOME}")
    return np.array([(p.pose.position.x, p.pose.position.y) for p in path.poses], float).reshape(
        -1, 2
    )


def place_of(message: PoseStamped, name: str) -> Tuple[float, float]:
    """x, y in home. Raises RouteError where it is in another frame."""
    if message.header.frame_id != frames.HOME:
        raise RouteError(
            f"the {name} is in frame '{message.header.frame_id}', not in {frames.HOME}"
        )
    return message.pose.position.x, message.pose.position.y


def refined_of(message: RefinedCameras) -> List[RefinedCamera]:
    """What a map found of its pictures' poses. Raises FcsvError where one is none, or another frame's."""
    if message.header.frame_id != frames.HOME:
        raise RouteError(f"refined poses are in '{message.header.frame_id}', not in {frames.HOME}")
    lists = message.vehicles, message.stamps, message.before, message.refined
    if len({len(each) for each in lists}) > 1:
        raise RouteError("refined poses: lists of different lengths")
    of = conversions.pose_to_transform
    return [RefinedCamera(n, s.to_sec(), of(told), of(new)) for n, s, told, new in zip(*lists)]


def cells_message(middles_m: np.ndarray, cell_m: float, stamp_s: float) -> GridCells:
    """Cells by their middles (N,2)."""
    cells = [Point(x, y, 0.0) for x, y in middles_m]
    return GridCells(conversions.header(stamp_s, frames.HOME), cell_m, cell_m, cells)


def twist_of(command: DriveCommand) -> Twist:
    """Speed and turning rate of a robot with wheels."""
    return Twist(Vector3(command.speed_mps, 0.0, 0.0), Vector3(0.0, 0.0, command.turning_radps))


def _seen_header(stamp_s: float) -> Header:
    return conversions.header(max(stamp_s, 0.0), frames.HOME)


def seen_s(message) -> float:
    """Gives when what a grid shows was seen, s; -inf where that is not known."""
    stamp_s = stamp_of(message)
    return stamp_s if stamp_s > 0.0 else -np.inf


def stamp_of(message) -> float:
    """Gives the stamp of a message's header, s."""
    return seconds(message.header.stamp)


def fix_of(message: PoseWithCovarianceStamped) -> PlaceFix:
    """A fix of the robot's place. Raises PlaceError where it is not in home, GeometryError where its
    pose is none."""
    if message.header.frame_id != frames.HOME:
        raise PlaceError(
            f"a fix is in frame '{message.header.frame_id}'; publish the robot's pose in {frames.HOME}"
        )
    T_home_robot = conversions.pose_to_transform(message.pose.pose)
    covariance = np.reshape(message.pose.covariance, (6, 6))[np.ix_(_XY_YAW, _XY_YAW)]
    x_m, y_m = map(float, T_home_robot[:2, 3])
    return PlaceFix(stamp_of(message), x_m, y_m, transforms.yaw(T_home_robot), covariance)


def fix_message(fix: PlaceFix) -> PoseWithCovarianceStamped:
    """The message of a fix in home."""
    return _placed(fix.stamp_s, fix.x_m, fix.y_m, fix.yaw_rad, fix.covariance)


def place_message(state: PlaceState) -> PoseWithCovarianceStamped:
    """The message of a place that is known; x and y share its sigma evenly."""
    place = state.place
    variances = [0.5 * place.sigma_m**2, 0.5 * place.sigma_m**2, state.yaw_sigma_rad**2]
    return _placed(place.stamp_s, place.x_m, place.y_m, place.yaw_rad, np.diag(variances))


def _placed(stamp_s: float, x_m: float, y_m: float, yaw_rad: float, covariance: np.ndarray):
    whole = np.zeros((6, 6))
    whole[np.ix_(_XY_YAW, _XY_YAW)] = covariance
    message = PoseWithCovarianceStamped(header=conversions.header(stamp_s, frames.HOME))
    T_home_robot = transforms.from_xyz_yaw([x_m, y_m, 0.0], yaw_rad)
    message.pose.pose = conversions.transform_to_pose(T_home_robot)
    message.pose.covariance = whole.ravel().tolist()
    return message


def wheels_of(message: Odometry) -> WheelOdometry:
    """What the wheels say, in the odometry's own frame. Raises GeometryError where its pose is
    none."""
    T_odom_robot = conversions.pose_to_transform(message.pose.pose)
    x_m, y_m = map(float, T_odom_robot[:2, 3])
    return WheelOdometry(stamp_of(message), x_m, y_m, transforms.yaw(T_odom_robot))


def sighting_of(message: Odometry, vehicle: str) -> VehicleSighting:
    """A vehicle in the robot's frame, as the tracker on the robot says it. Raises GeometryError
    where its pose is none."""
    T_robot_body = conversions.pose_to_transform(message.pose.pose)
    covariance = np.reshape(message.pose.covariance, (6, 6))
    return VehicleSighting.of_pose(stamp_of(message), vehicle, T_robot_body, covariance)


def vehicle_odometry_of(message: Odometry, vehicle: str) -> UntrackedOdometry:
    """What a vehicle says of its own way. Raises GeometryError where its pose is none."""
    T_odom_body = conversions.pose_to_transform(message.pose.pose)
    x_m, y_m = map(float, T_odom_body[:2, 3])
    return UntrackedOdometry(stamp_of(message), vehicle, x_m, y_m, transforms.yaw(T_odom_body))


def robot_start_of(message: Home, sigma_m: float, sigma_deg: float) -> RobotStart:
    """Where the robot stands in a home that was set in its own frame. Raises GeometryError where
    its pose is none."""
    T_home_robot = transforms.invert(conversions.pose_to_transform(message.home_in_odom))
    x_m, y_m = map(float, T_home_robot[:2, 3])
    covariance = np.diag([sigma_m**2, sigma_m**2, np.radians(sigma_deg) ** 2])
    return RobotStart(stamp_of(message), x_m, y_m, transforms.yaw(T_home_robot), covariance)


def odometry_message(wheels: WheelOdometry, odom: str, base: str) -> Odometry:
    """The message of wheel odometry between frames ``odom`` and ``base``."""
    message = Odometry(header=conversions.header(wheels.stamp_s, odom), child_frame_id=base)
    T_odom_robot = transforms.from_xyz_yaw([wheels.x_m, wheels.y_m, 0.0], wheels.yaw_rad)
    message.pose.pose = conversions.transform_to_pose(T_odom_robot)
    return message
