# SPDX-License-Identifier: Apache-2.0
"""The pose of each camera's optical frame at a stamp, from what a pose source, tf and the mount
say. No I/O.
"""

from dataclasses import dataclass, field
from typing import Callable, List, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo.bag_import.frame_tree import FrameTree
from fcsv_stereo.bag_import.request import AXES, CameraRequest, numbers_of
from fcsv_stereo.errors import InputError
from fcsv_stereo.pose_covariance import KnownCovariances, carried, turned

_OPTICAL = "optical"  # what the name of an optical frame holds (REP 103)
_HOW = (
    "--mount optical (the pose is of the camera, z forward), camera (of it, x forward), x,y,z,roll,pitch,yaw (m, "
    "degrees), or a FRAME of tf"
)
At = Callable[[float], np.ndarray]


@dataclass(frozen=True)
class PoseSource:
    """Poses of one body. ``world`` and ``body`` are frames; empty: the source names none.
    ``span_s``: first and last stamp; None: tf's.
    """

    name: str
    world: str
    body: str
    at: At
    span_s: Optional[Tuple[float, float]] = None
    covariances: Optional[KnownCovariances] = None

    @classmethod
    def of_track(
        cls, name: str, frames: Tuple[str, str], track: Trajectory, covariances=None
    ) -> "PoseSource":
        return cls(name, *frames, track.at, track.span_s, covariances)

    @classmethod
    def of_frame(cls, frame: str, world: Optional[str], tree: FrameTree) -> "PoseSource":
        """Raises InputError where a frame is not in the tree."""
        tree.require(frame)
        root = tree.root(frame) if world is None else tree.require(world)
        if root == frame:
            raise InputError(
                f"--pose {frame}: is the root of tf; name the frame of the camera or its body"
            )
        if not tree.connected(root, frame):
            raise InputError(
                f"tf does not connect '{root}' and '{frame}'; the root of '{frame}' is '{tree.root(frame)}'"
            )
        return cls(
            f"tf {root} to {frame}", root, frame, lambda stamp_s: tree.at(root, frame, stamp_s)
        )


@dataclass(frozen=True)
class BagCamera:
    """``T_world_cam`` at a stamp raises PoseUnavailable. ``covariance`` (6, 6) is about the world's
    axes.
    """

    source: PoseSource
    T_target_world: At
    T_body_cam: At
    said: List[str] = field(default_factory=list)

    def T_world_cam(self, stamp_s: float) -> np.ndarray:
        """(4, 4) of the optical frame in the world of all cameras."""
        return self.T_target_world(stamp_s) @ self.source.at(stamp_s) @ self.T_body_cam(stamp_s)

    def covariance(self, stamp_s: float) -> Optional[np.ndarray]:
        """(6, 6) of the camera's position and small turn about the world's axes; None where none
        was said.
        """
        known = None if self.source.covariances is None else self.source.covariances.at(stamp_s)
        if known is None:
            return None
        T_target_world = self.T_target_world(stamp_s)
        p_body = (T_target_world @ self.source.at(stamp_s))[:3, 3]
        F = carried(self.T_world_cam(stamp_s)[:3, 3] - p_body)
        return F @ turned(known, T_target_world[:3, :3]) @ F.T


def posed_camera(
    request: CameraRequest, source: PoseSource, picture_frame: str, tree: FrameTree, target: str
) -> BagCamera:
    """``target``: the world of all cameras; empty: no source names one. Raises InputError naming
    what is not known.
    """
    said: List[str] = []
    T_body_cam = _mount(request, source, picture_frame, tree, said)
    T_target_world = _world(source, target, tree, said)
    return BagCamera(source, T_target_world, T_body_cam, said)


def _world(source: PoseSource, target: str, tree: FrameTree, said: List[str]) -> At:
    if source.world == target:
        return _constant(np.eye(4))
    if not source.world:
        said.append(f"{source.name} names no frame: its poses are taken as in '{target}'")
        return _constant(np.eye(4))
    known = {target, source.world} <= set(tree.frames)
    if not known or not tree.connected(target, source.world):
        raise InputError(
            f"{source.name} is in frame '{source.world}', other poses or --world in '{target}', and the bag's tf does "
            "not connect them: take poses of one frame"
        )
    return lambda stamp_s: tree.at(target, source.world, stamp_s)


def _mount(
    request: CameraRequest, source: PoseSource, frame: str, tree: FrameTree, said: List[str]
) -> At:
    """T_body_cam, the camera's optical frame."""
    where = f"--camera {request.topic}"
    body = source.body
    if request.mount is not None:
        numbers = numbers_of(request.mount)
        if numbers is not None:
            return _constant(numbers)
        body = tree.require(request.mount)
    if not body:
        raise InputError(f"{where}: {source.name} does not say what it is the pose of: give {_HOW}")
    if request.axes is None and frame not in tree.frames and body != frame and _OPTICAL in body:
        said.append(
            f"frame '{frame}' of {request.topic} is not in tf: '{body}' is taken as its optical frame"
        )
        return _constant(AXES["optical"])
    axes = _axes(where, request, frame)
    if body == frame:
        return _constant(axes)
    lacking = next((f for f in (body, frame) if f not in tree.frames), None)
    if lacking is None and tree.connected(body, frame):
        return lambda stamp_s: tree.at(body, frame, stamp_s) @ axes
    why = "tf does not connect them" if lacking is None else f"'{lacking}' is not in tf"
    raise InputError(
        f"{where}: the pose is of '{body}', the pictures are of frame '{frame}', and {why}: give {_HOW}"
    )


def _axes(where: str, request: CameraRequest, frame: str) -> np.ndarray:
    """T_frame_optical of the frame that the pictures name. Raises InputError where it is not
    known."""
    if request.axes is not None:
        return AXES[request.axes]
    if _OPTICAL in frame:
        return AXES["optical"]
    raise InputError(
        f"{where}: its pictures are of frame '{frame}', which does not say that it is optical: give --axes optical "
        f"(its z looks forward) or --axes camera (its x does), or {_HOW}"
    )


def _constant(T: np.ndarray) -> At:
    return lambda stamp_s: T


def pose_all(
    camera: BagCamera, stamps_s: List[float]
) -> Tuple[List[Tuple[float, np.ndarray]], List[str]]:
    """(stamp, T_world_cam) of the stamps that have one, and why the others have none."""
    found, why = [], []
    for stamp_s in stamps_s:
        try:
            found.append(
                (stamp_s, transforms.require_rigid(camera.T_world_cam(stamp_s), camera.source.name))
            )
        except PoseUnavailable as error:
            why.append(str(error))
    return found, why
