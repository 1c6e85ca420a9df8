# SPDX-License-Identifier: Apache-2.0
"""One pass over the bags: stamps of pictures, camera_info, poses and tf, without the pictures
themselves.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Sequence, Set, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.bags import reading
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import BagError, GeometryError
from fcsv_geometry.intrinsics import camera_of_matrix
from fcsv_geometry.messages import (
    camera_from_info,
    info_field,
    pose_to_transform,
    seconds,
    transform_from_msg,
)
from fcsv_stereo.bag_import.contents import TF, base_of
from fcsv_stereo.bag_import.frame_tree import FrameCollector
from fcsv_stereo.errors import InputError
from fcsv_stereo.pose_covariance import KnownCovariances, checked
from fcsv_stereo.sessions.left_out import LeftOut
from fcsv_stereo.sessions.stamped import Stamped

_SAME_ROTATION = 1e-6


@dataclass
class PoseTopic:
    """``names``: (world, body) frames that its messages name, body empty where they name none."""

    poses: Stamped
    names: Set[Tuple[str, str]] = field(default_factory=set)
    covariances: KnownCovariances = field(default_factory=KnownCovariances)


@dataclass
class PictureTopic:
    """``frames`` are those that its messages name; values of ``stamps`` are nothing."""

    stamps: Stamped
    infos: Stamped
    frames: Set[str] = field(default_factory=set)
    R_raw_rectified: List[np.ndarray] = field(default_factory=list)
    second_of_pair_m: float = 0.0


@dataclass
class BagContents:
    """Holds by topic what was recorded; ``lags_s``: by topic the time from each stamp to its
    recording (s).
    """

    pictures: Dict[str, PictureTopic]
    poses: Dict[str, PoseTopic]
    frames: FrameCollector = field(default_factory=FrameCollector)
    lags_s: Dict[str, List[float]] = field(default_factory=dict)
    left_out: LeftOut = field(default_factory=LeftOut)

    def lag_s(self, topics: Sequence[str]) -> float:
        """Median over topics; NaN where none has messages."""
        lags = [lag for t in topics for lag in self.lags_s.get(t, ())]
        return float(np.median(lags)) if lags else float("nan")


def stamp_of(message, recorded_s: float, by_receipt: bool) -> float:
    """The time (s) that counts for a message with a header."""
    return recorded_s if by_receipt else seconds(message.header.stamp)


class BagPass:
    """Reads ``pictures`` (topic of pictures to topic of camera_info) and ``poses`` (topics), and
    tf.
    """

    def __init__(
        self, pictures: Dict[str, str], poses: Sequence[str], by_receipt: bool, warnings: List[str]
    ):
        self.contents = BagContents(
            {t: PictureTopic(Stamped(t), Stamped(info)) for t, info in pictures.items()},
            {t: PoseTopic(Stamped(t)) for t in poses},
        )
        self._by_receipt, self._warnings = by_receipt, warnings
        self._infos: Dict[str, List[str]] = {}
        for pictures_topic, info in pictures.items():
            self._infos.setdefault(info, []).append(pictures_topic)
        self._cameras: Dict[tuple, PinholeCamera] = {}

    def read(self, path: Path) -> None:
        """A bag; of one that cannot be read on, what came before."""
        wanted = {*self.contents.pictures, *self.contents.poses, *self._infos}
        try:
            for topic, recorded_s, message in reading.timed_messages(
                path, lambda t, kind: t in wanted or kind in TF, self._broken
            ):
                self._add(path, topic, recorded_s, message)
        except BagError as error:
            self._warnings.append(f"{error}; what follows there is left out")

    def _broken(self, topic: str, recorded_s: float, why: str) -> None:
        self.contents.left_out.add(
            topic, recorded_s, f"its bytes are no message of its type ({why})"
        )

    def _add(self, path: Path, topic: str, recorded_s: float, message) -> None:
        if hasattr(message, "transforms"):
            for t in message.transforms:
                self._add_transform(path, topic, recorded_s, t)
            return
        stamp_s = stamp_of(message, recorded_s, self._by_receipt)
        self.contents.lags_s.setdefault(topic, []).append(
            recorded_s - seconds(message.header.stamp)
        )
        try:
            if topic in self.contents.pictures:
                self.contents.pictures[topic].stamps.add(path, stamp_s)
                self.contents.pictures[topic].frames.add(_frame(message.header.frame_id))
            elif topic in self._infos:
                for of in self._infos[topic]:
                    self._add_info(path, self.contents.pictures[of], stamp_s, message)
            else:
                self._add_pose(path, self.contents.poses[topic], stamp_s, message)
        except GeometryError as error:
            self.contents.left_out.add(topic, stamp_s, str(error))

    def _add_info(self, path: Path, pictures: PictureTopic, stamp_s: float, message) -> None:
        """Takes the intrinsics: of rectified pictures P holds, and R turns the camera; of others K
        and D."""
        if not base_of(pictures.stamps.topic).rpartition("/")[2].startswith("image_rect"):
            camera = camera_from_info(message)
        else:
            P, R = (np.array(info_field(message, name), float) for name in "PR")
            P = P.reshape(3, 4)
            camera = camera_of_matrix(
                message.width, message.height, P[:, :3].ravel(), (), "plumb_bob"
            )
            R = transforms.require_rigid(
                transforms.transform(R.reshape(3, 3), np.zeros(3)), "camera_info's R"
            )[:3, :3]
            if not any(
                np.allclose(R.T, known, atol=_SAME_ROTATION) for known in pictures.R_raw_rectified
            ):
                pictures.R_raw_rectified.append(R.T)
            pictures.second_of_pair_m = -P[0, 3] / P[0, 0]
        pictures.infos.add(path, stamp_s, camera)

    def _add_pose(self, path: Path, of: PoseTopic, stamp_s: float, message) -> None:
        pose = getattr(message, "pose", None)
        if pose is None:
            T_world_body = transform_from_msg(message.transform)
        else:
            covariance = getattr(pose, "covariance", None)
            T_world_body = pose_to_transform(pose if covariance is None else pose.pose)
            if covariance is not None:
                try:
                    of.covariances.add(stamp_s, checked(covariance, of.poses.topic))
                except InputError as error:  # the map can do without, and says so
                    of.covariances.refused = str(error)
        of.names.add(
            (_frame(message.header.frame_id), _frame(getattr(message, "child_frame_id", "")))
        )
        of.poses.add(path, stamp_s, T_world_body)

    def _add_transform(self, path: Path, topic: str, recorded_s: float, t) -> None:
        names, stamp_s = (
            (_frame(t.header.frame_id), _frame(t.child_frame_id)),
            stamp_of(t, recorded_s, self._by_receipt),
        )
        static = topic.rstrip("/").endswith("tf_static")
        if not static:
            self.contents.lags_s.setdefault(topic, []).append(recorded_s - seconds(t.header.stamp))
        try:
            T_parent_child = transform_from_msg(t.transform)
        except GeometryError as error:
            self.contents.left_out.add(f"tf {names[0]} to {names[1]}", stamp_s, str(error))
            return
        said = self.contents.frames.add(static, names, path, stamp_s, T_parent_child)
        if said and said not in self._warnings:
            self._warnings.append(said)


def _frame(name: str) -> str:
    """
    >>> _frame("/base_link")
    'base_link'
    """
    return name.strip().lstrip("/")
