# SPDX-License-Identifier: Apache-2.0
"""The site as MCAP with ROS 2's standard messages, for Foxglove, Lichtblick, and ``ros2 bag play``
(rosbags): points, surface, orthophoto, stations, edges, tf, and each view's picture with its
camera."""

import re
import tempfile
from pathlib import Path
from typing import Any, Dict, List, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.errors import SurveyError
from fcsv_stereo.model import concatenate
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.document import Site
from fcsv_stereo.survey.placing.adjust import Placed
from fcsv_stereo.survey.surface.octree import levels
from fcsv_stereo.survey.surface.rasters import Rasters
from fcsv_stereo.survey.views.inputs import different
from fcsv_stereo.survey.views.view_file import ViewFile

FRAME = "site"
_STAMP_NS = 10**9  # one moment for all; zero is "none" to ROS
_MOST_POINTS, _MOST_CELLS = 500_000, 500_000
_MOST_LOOKED_AT = 4_000_000  # points of which these are chosen
_MOST_PX, _VIEW_PX = 4096, 640  # longer side of the orthophoto, width of a view's picture
_EDGE_M, _NAME_M = 0.2, 2.0  # width of an edge's line, height of a view's name
_KEPT_RGBA, _THROWN_RGBA, _NAME_RGBA = (0.1, 0.8, 0.2, 0.9), (0.9, 0.1, 0.1, 0.6), (1, 1, 1, 1)
_LINES, _TEXT = 5, 9  # visualization_msgs/Marker: LINE_LIST, TEXT_VIEW_FACING
_FLOAT32, _UINT32 = 7, 6  # sensor_msgs/PointField


def check_library() -> None:
    """Raises SurveyError where rosbags is too old to write MCAP."""
    try:
        from rosbags.rosbag2 import StoragePlugin  # noqa: F401
    except ImportError as error:
        raise SurveyError(
            "the product mcap needs rosbags 0.10 or newer, which needs Python 3.10; leave it out, or run fcsv "
            "survey from the wheel"
        ) from error


def write_recording(site: Site, rasters: Rasters, path: Path) -> None:
    """The site's MCAP, in frame ``site``, less the site's origin. Raises OSError."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
    from rosbags.typesys import Stores, get_typestore

    messages = _Messages(get_typestore(Stores.ROS2_HUMBLE))
    with tempfile.TemporaryDirectory(dir=path.parent) as made:
        writer = Writer(Path(made) / path.stem, version=8, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            for topic, kind, message in messages.of_site(site, rasters):
                channel = writer.add_connection(topic, kind, typestore=messages.store)
                writer.write(channel, _STAMP_NS, messages.store.serialize_cdr(message, kind))
        (Path(made) / path.stem / f"{path.stem}.mcap").replace(path)


class _Messages:
    """Makes ROS 2's messages by the definitions of ``store``."""

    def __init__(self, store: Any):
        self.store = store

    def of_site(self, site: Site, rasters: Rasters) -> List[Tuple[str, str, Any]]:
        """(topic, type, message) of all that is written."""
        placed = site.adjusted.placed
        views = {v.name: v for v in site.views if v.name in placed}
        poses = {n: _pose(p, site.origin_m) for n, p in placed.items()}
        frames = dict(zip(views, _frames(list(views))))
        found = [
            ("/tf_static", "tf2_msgs/msg/TFMessage", self._tf(poses, frames)),
            ("/site/points", "sensor_msgs/msg/PointCloud2", self._points(site)),
            ("/site/surface", "sensor_msgs/msg/PointCloud2", self._surface(rasters, site)),
            (
                "/site/orthophoto",
                "sensor_msgs/msg/CompressedImage",
                self._picture(_shrunk(rasters.surface.rgb, _MOST_PX)[0], FRAME),
            ),
            ("/site/stations", "geometry_msgs/msg/PoseArray", self._stations(poses)),
            ("/site/edges", "visualization_msgs/msg/MarkerArray", self._edges(site, poses)),
        ]
        for name, view in views.items():
            frame = frames[name]
            picture, share = _shrunk(view.load().image, _VIEW_PX)
            found += [
                (
                    f"/{frame}/image",
                    "sensor_msgs/msg/CompressedImage",
                    self._picture(picture, frame),
                ),
                (
                    f"/{frame}/camera_info",
                    "sensor_msgs/msg/CameraInfo",
                    self._camera(view, share, frame),
                ),
            ]
        return found

    def _made(self, kind: str, **fields: Any) -> Any:
        package, name = kind.split("/")
        return self.store.types[f"{package}/msg/{name}"](**fields)

    def _header(self, frame: str = FRAME) -> Any:
        stamp = self._made("builtin_interfaces/Time", sec=_STAMP_NS // 10**9, nanosec=0)
        return self._made("std_msgs/Header", stamp=stamp, frame_id=frame)

    def _at(self, T: np.ndarray) -> Tuple[Any, Any]:
        """Point and quaternion."""
        x, y, z, w = map(float, transforms.quaternion_xyzw(T))
        point = self._made("geometry_msgs/Point", **dict(zip("xyz", map(float, T[:3, 3]))))
        return point, self._made("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)

    def _tf(self, poses: Dict[str, np.ndarray], frames: Dict[str, str]) -> Any:
        stamped = []
        for name, T in poses.items():
            at, turn = self._at(T)
            place = self._made("geometry_msgs/Vector3", x=at.x, y=at.y, z=at.z)
            moved = self._made("geometry_msgs/Transform", translation=place, rotation=turn)
            stamped.append(
                self._made(
                    "geometry_msgs/TransformStamped",
                    header=self._header(),
                    child_frame_id=frames[name],
                    transform=moved,
                )
            )
        return self._made("tf2_msgs/TFMessage", transforms=stamped)

    def _stations(self, poses: Dict[str, np.ndarray]) -> Any:
        """Poses with x where each view looks."""
        found = []
        for T in poses.values():
            at, turn = self._at(T @ transforms.invert(_T_LOOK_CAM))
            found.append(self._made("geometry_msgs/Pose", position=at, orientation=turn))
        return self._made("geometry_msgs/PoseArray", header=self._header(), poses=found)

    def _points(self, site: Site) -> Any:
        """The cloud, thinned evenly as COPC's coarse levels are."""
        share, random = _MOST_LOOKED_AT / site.count, np.random.default_rng(0)
        clouds = site.clouds()
        if share < 1.0:
            clouds = (c[random.random(len(c)) < share] for c in clouds)
        cloud = concatenate(list(clouds))
        of = _thinned(cloud.points_home_m.astype(float))
        values = {"sigma": cloud.sigma_m[of], "views": cloud.baseline_index[of]}
        return self._cloud(cloud.points_home_m[of], cloud.colors[of], values)

    def _surface(self, rasters: Rasters, site: Site) -> Any:
        """Cells of the surface model with the orthophoto's colours; of a large one each n-th."""
        surface, cell_m, corner_m = rasters.surface, rasters.cell_m, rasters.corner_m
        n = 1 + int(np.sqrt(np.isfinite(surface.height).sum() / _MOST_CELLS))
        rows, columns = np.nonzero(np.isfinite(surface.height[::n, ::n]))
        rows, columns = rows * n, columns * n
        x = corner_m[0] - site.origin_m[0] + (columns + 0.5) * cell_m
        y = corner_m[1] - site.origin_m[1] - (rows + 0.5) * cell_m
        points = np.column_stack([x, y, surface.height[rows, columns] - site.origin_m[2]])
        values = {"sigma": surface.sigma[rows, columns], "views": surface.views[rows, columns]}
        return self._cloud(points, surface.rgb[rows, columns], values)

    def _cloud(self, points: np.ndarray, rgb: np.ndarray, values: Dict[str, np.ndarray]) -> Any:
        names = ("x", "y", "z", "rgb", *values)
        record = np.zeros(len(points), [(n, "<u4" if n == "rgb" else "<f4") for n in names])
        for i, axis in enumerate("xyz"):
            record[axis] = points[:, i]
        red, green, blue = rgb.astype(np.uint32).T
        record["rgb"] = (red << 16) | (green << 8) | blue
        for name, value in values.items():
            record[name] = value
        fields = [
            self._made(
                "sensor_msgs/PointField",
                name=name,
                offset=4 * i,
                datatype=_UINT32 if name == "rgb" else _FLOAT32,
                count=1,
            )
            for i, name in enumerate(names)
        ]
        return self._made(
            "sensor_msgs/PointCloud2",
            header=self._header(),
            height=1,
            width=len(record),
            fields=fields,
            is_bigendian=False,
            point_step=record.itemsize,
            row_step=record.nbytes,
            data=np.frombuffer(record.tobytes(), np.uint8),
            is_dense=True,
        )

    def _picture(self, rgb: np.ndarray, frame: str) -> Any:
        _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
        return self._made(
            "sensor_msgs/CompressedImage",
            header=self._header(frame),
            format="jpeg",
            data=jpeg.ravel(),
        )

    def _camera(self, view: ViewFile, share: float, frame: str) -> Any:
        c = view.camera
        fx, fy, cx, cy = (
            c.fx * share,
            c.fy * share,
            (c.cx + 0.5) * share - 0.5,
            (c.cy + 0.5) * share - 0.5,
        )
        K = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        P = np.column_stack([K.reshape(3, 3), np.zeros(3)]).ravel()
        roi = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
        return self._made(
            "sensor_msgs/CameraInfo",
            header=self._header(frame),
            height=round(c.height * share),
            width=round(c.width * share),
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=K,
            r=np.eye(3).ravel(),
            p=P,
            binning_x=0,
            binning_y=0,
            roi=self._made("sensor_msgs/RegionOfInterest", **roi),
        )

    def _edges(self, site: Site, poses: Dict[str, np.ndarray]) -> Any:
        """Lines between views that edges join, those that were thrown out in red, and names."""
        kept: List[np.ndarray] = []
        thrown: List[np.ndarray] = []
        for e in site.adjusted.edges:
            if e.a in poses and e.b in poses and e.S_a_b is not None:
                (kept if e.kept else thrown).extend(poses[n][:3, 3] for n in (e.a, e.b))
        markers = [
            self._marker("kept", 0, _LINES, _EDGE_M, _KEPT_RGBA, points=kept),
            self._marker("thrown out", 0, _LINES, _EDGE_M, _THROWN_RGBA, points=thrown),
        ]
        markers += [
            self._marker("views", i, _TEXT, _NAME_M, _NAME_RGBA, at=T[:3, 3], text=name)
            for i, (name, T) in enumerate(poses.items())
        ]
        return self._made("visualization_msgs/MarkerArray", markers=markers)

    def _marker(
        self,
        namespace: str,
        number: int,
        kind: int,
        size_m: float,
        rgba,
        points=(),
        at=None,
        text="",
    ) -> Any:
        T = transforms.transform(np.eye(3), np.zeros(3) if at is None else at)
        position, turn = self._at(T)
        nothing = self._made("builtin_interfaces/Duration", sec=0, nanosec=0)
        picture = self._made(
            "sensor_msgs/CompressedImage",
            header=self._header(),
            format="",
            data=np.zeros(0, np.uint8),
        )
        no_mesh = self._made("visualization_msgs/MeshFile", filename="", data=np.zeros(0, np.uint8))
        return self._made(
            "visualization_msgs/Marker",
            header=self._header(),
            ns=namespace,
            id=number,
            type=kind,
            action=0,
            pose=self._made("geometry_msgs/Pose", position=position, orientation=turn),
            scale=self._made("geometry_msgs/Vector3", x=size_m, y=size_m, z=size_m),
            color=self._made("std_msgs/ColorRGBA", **dict(zip("rgba", map(float, rgba)))),
            lifetime=nothing,
            frame_locked=False,
            points=[
                self._made("geometry_msgs/Point", **dict(zip("xyz", map(float, p)))) for p in points
            ],
            colors=[],
            texture_resource="",
            texture=picture,
            uv_coordinates=[],
            text=text,
            mesh_resource="",
            mesh_file=no_mesh,
            mesh_use_embedded_materials=False,
        )


#: from a camera's optical frame to one whose x looks forward
_T_LOOK_CAM = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


def _pose(placed: Placed, origin_m: np.ndarray) -> np.ndarray:
    """T_site_cam, less the origin."""
    place = similarity.place(placed.S_site_cam) - origin_m
    return transforms.transform(similarity.rotation(placed.S_site_cam), place)


def _frames(names: List[str]) -> List[str]:
    """Frames that are topics, too.

    >>> _frames(["north-1", "north.1", "3"])
    ['view_north_1', 'view_north_1_2', 'view_3']
    """
    words = [re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") for name in names]
    return [frame.replace("-", "_") for frame in different([f"view_{w}" for w in words])]


def _thinned(points: np.ndarray) -> np.ndarray:
    """Indices of points (N,3), whole levels of the octree as far as they are not too many."""
    if not len(points):
        return np.zeros(0, int)
    low = points.min(axis=0)
    side_m = float((points.max(axis=0) - low).max()) + 0.01
    by_level: Dict[int, List[np.ndarray]] = {}
    for (level, *_), of in levels(points, low, side_m):
        by_level.setdefault(level, []).append(of)
    chosen, count = [], 0
    for of_level in by_level.values():
        more = np.concatenate(of_level)
        if chosen and count + len(more) > _MOST_POINTS:
            break
        chosen.append(more)
        count += len(more)
    return np.sort(np.concatenate(chosen))


def _shrunk(rgb: np.ndarray, most_px: int) -> Tuple[np.ndarray, float]:
    """The picture at most so large, and by which share it shrank."""
    share = min(1.0, most_px / max(rgb.shape[:2]))
    if share == 1.0:
        return np.ascontiguousarray(rgb), 1.0
    size = round(rgb.shape[1] * share), round(rgb.shape[0] * share)
    return cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), share
