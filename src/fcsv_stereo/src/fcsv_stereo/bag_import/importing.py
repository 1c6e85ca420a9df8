# SPDX-License-Identifier: Apache-2.0
"""A bag's pictures and poses as a folder that ``map`` reads: the story from topics to posed
photographs.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Callable, Dict, List, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry.bags import reading
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import BagError
from fcsv_geometry.programs.writing import require_folder
from fcsv_stereo.bag_import import contents
from fcsv_stereo.bag_import.choice import PosedStamp, choose
from fcsv_stereo.bag_import.frame_tree import FrameTree
from fcsv_stereo.bag_import.posing import BagCamera, PoseSource, pose_all, posed_camera
from fcsv_stereo.bag_import.recorded import BagContents, BagPass, PictureTopic, stamp_of
from fcsv_stereo.bag_import.request import CameraRequest, ImportRequest
from fcsv_stereo.bag_import.tum import read_tum
from fcsv_stereo.errors import InputError, OutputError
from fcsv_stereo.map_files.staging import StagedFolder, check_new
from fcsv_stereo.photos.models import write_model
from fcsv_stereo.posed import priors
from fcsv_stereo.posed.colmap_images import PosedImage
from fcsv_stereo.posed.exposure import Exposure
from fcsv_stereo.sessions.cameras import timeline
from fcsv_stereo.sessions.files import bags_of
from fcsv_stereo.sessions.pictures import compressed_rgb_of, rgb_of
from fcsv_stereo.sessions.stamped import Stamped
from fcsv_stereo.sessions.tracks import track_of

_OTHER_CLOCK_S = 0.2  # between the lags of pictures and poses: more is no transport
_ROUNDS = 5  # in which pictures that turn out damaged are replaced
_COLMAP_COEFFICIENTS = 4  # k1, k2, p1, p2 are what OPENCV's model has
Step = Callable[[str, float], None]


@dataclass(frozen=True)
class ImportedPicture:
    """A picture that was written: its name, topic and stamp (s), T_world_cam, and its covariance,
    if known.
    """

    name: str
    topic: str
    posed: PosedStamp
    covariance: Optional[np.ndarray]


@dataclass(frozen=True)
class ImportedBag:
    """The reference first. ``world``: the frame of the poses; empty: none was named. ``lags_s``: by
    source its name and the time from stamp to recording (s).
    """

    pictures: List[ImportedPicture]
    world: str
    lags_s: Dict[str, float] = field(default_factory=dict)
    warnings: List[str] = field(default_factory=list)
    has_priors: bool = False


def import_bag(
    paths: Sequence[Path], out: Path, request: ImportRequest, step: Step = lambda *_: None
) -> ImportedBag:
    """``out`` with images/, cameras.txt, images.txt and, where messages say it, priors.csv. Nothing
    is left where it fails. Raises InputError for what is wrong with the bags, OutputError where
    ``out`` is not empty.
    """
    check_new(out)
    require_folder(out)
    warnings: List[str] = []
    bags = [bag for path in paths for bag in bags_of(path, warnings)]
    sources = _Sources(request, contents.topics_of(bags))
    step("reading stamps and poses", 0.0)
    recorded = sources.read(bags, warnings)
    posing = _Posing(request, sources, recorded, warnings)
    posed = [p for k in range(len(request.cameras)) for p in posing.posed(k)]
    chosen, images = _chosen(bags, request, sources, recorded, posed, warnings, step)
    _require_one_size(request, chosen)
    step("writing pictures", 0.9)
    names = _names(chosen)
    done = [
        ImportedPicture(
            n, request.cameras[p.camera].topic, p, posing.cameras[p.camera].covariance(p.stamp_s)
        )
        for n, p in zip(names, chosen)
    ]
    has_priors = all(d.covariance is not None for d in done)
    if not has_priors:
        warnings += posing.without_covariance(done)
    _write(out, done, images, has_priors, warnings)
    lags = {t: recorded.lag_s([t]) for t in (*recorded.pictures, *recorded.poses)}
    return ImportedBag(
        done, posing.world, lags, [*warnings, *recorded.left_out.warnings()], has_priors
    )


class _Sources:
    """Which topics serve each camera. Raises InputError that lists what there is."""

    def __init__(self, request: ImportRequest, topics: Dict[str, str]):
        self._request, self.topics = request, topics
        self.pictures = [contents.picture_topic(c.topic, topics) for c in request.cameras]
        infos = [
            contents.info_topic(t, c.info or "", topics)
            for t, c in zip(self.pictures, request.cameras)
        ]
        self._infos = dict(zip(self.pictures, infos))
        self.poses = [self._pose_topic(c.pose) for c in request.cameras]

    def read(self, bags: Sequence[Path], warnings: List[str]) -> BagContents:
        wanted = [t for t in self.poses if t]
        reader = BagPass(
            self._infos, list(dict.fromkeys(wanted)), self._request.by_receipt, warnings
        )
        for bag in bags:
            reader.read(bag)
        return reader.contents

    def _pose_topic(self, pose: str) -> str:
        """Empty where it is a file or a frame."""
        if self.topics.get(pose) in contents.POSES:
            return pose
        if pose in self.topics:
            raise InputError(f"--pose {pose}: is of type {self.topics[pose]}; {self._there()}")
        if pose.startswith("/") and not Path(pose).is_file():
            raise InputError(f"--pose {pose}: is no topic of the bag and no file; {self._there()}")
        if not Path(pose).is_file() and not any(
            kind in contents.TF for kind in self.topics.values()
        ):
            raise InputError(
                f"--pose {pose}: is no file, and the bag has no tf with such a frame; {self._there()}"
            )
        return ""

    def _there(self) -> str:
        return f"topics of poses there: {contents.listed(self.topics, contents.POSES)}"


class _Posing:
    """Cameras with their poses, in one world."""

    def __init__(
        self, request: ImportRequest, sources: _Sources, recorded: BagContents, warnings: List[str]
    ):
        self._request, self._recorded, self._warnings = request, recorded, warnings
        self._topics, self._pose_topics = sources.pictures, sources.poses
        self._tf_topics = [t for t, kind in sources.topics.items() if kind in contents.TF]
        tree = recorded.frames.tree(request.gap_s, recorded.left_out, warnings)
        found = [self._source(c, t, tree) for c, t in zip(request.cameras, sources.poses)]
        self.world = request.world or next((s.world for s in found if s.world), "")
        if request.world is not None and any(s.world not in ("", self.world) for s in found):
            tree.require(self.world)
        self.cameras: List[BagCamera] = []
        for c, t, s in zip(request.cameras, sources.pictures, found):
            self.cameras.append(posed_camera(c, s, self._frame(t), tree, self.world))
            warnings += self.cameras[-1].said

    def posed(self, number: int) -> List[PosedStamp]:
        """Pictures of a camera that have a pose. Raises InputError where none has."""
        request, topic, camera = (
            self._request.cameras[number],
            self._topics[number],
            self.cameras[number],
        )
        of = self._recorded.pictures[topic]
        stamps = of.stamps.in_order(
            lambda a, b: a == b, self._recorded.left_out, self._warnings, None
        )
        if not stamps:
            raise InputError(f"topic {topic}: {self._none(topic)}")
        timelines = timeline(of.infos, self._recorded.left_out, self._warnings)
        if not timelines:
            raise InputError(f"topic {of.infos.topic}: {self._none(of.infos.topic)}")
        lag_s = self._other_clock(number)
        found, why = pose_all(camera, [s + request.offset_s for s, _ in stamps])
        if not found:
            raise InputError(
                self._uncovered(
                    topic, camera, [s + request.offset_s for s, _ in stamps], why[0], lag_s
                )
            )
        if why:
            self._warnings.append(
                f"{len(why)} of {len(stamps)} pictures of {topic} have no pose, the first: {why[0]}"
            )
        own = {s + request.offset_s: s for s, _ in stamps}
        turn = self._rectification(of)
        return [PosedStamp(number, s, own[s], timelines[0].at(own[s]), T @ turn) for s, T in found]

    def without_covariance(self, done: Sequence[ImportedPicture]) -> List[str]:
        """Why there is no priors.csv."""
        why = [
            of.covariances.refused for of in self._recorded.poses.values() if of.covariances.refused
        ]
        sources = sorted(
            {self.cameras[d.posed.camera].source.name for d in done if d.covariance is None}
        )
        said = f" ({why[0]})" if why else ""
        return [
            f"how well poses are known is not said by {', '.join(sources)}{said}: map assumes it (--prior-...)"
        ]

    def _source(self, camera: CameraRequest, topic: str, tree: FrameTree) -> PoseSource:
        recorded, gap_s = self._recorded, self._request.gap_s
        if not topic and not Path(camera.pose).is_file():
            return PoseSource.of_frame(camera.pose.lstrip("/"), self._request.world, tree)
        names, covariances = ("", ""), None
        if topic:
            of = recorded.poses[topic]
            if len(of.names) > 1:
                said = ", ".join(sorted(f"'{body}' in '{world}'" for world, body in of.names))
                raise InputError(
                    f"topic {topic}: its poses are of several frames: {said}; take one that has one"
                )
            names, poses, covariances = next(iter(of.names), names), of.poses, of.covariances
        else:
            poses = Stamped(camera.pose)
            for stamp_s, T_world_body in read_tum(Path(camera.pose)):
                poses.add(camera.pose, stamp_s, T_world_body)
        tracks = track_of(poses, recorded.left_out, self._warnings)
        if not tracks:
            raise InputError(f"--pose {camera.pose}: {self._none(poses.topic)}")
        track = tracks[0] if gap_s is None else tracks[0].bridging(gap_s)
        return PoseSource.of_track(camera.pose, names, track, covariances)

    def _frame(self, topic: str) -> str:
        frames = self._recorded.pictures[topic].frames
        if len(frames) > 1:
            raise InputError(
                f"topic {topic}: its pictures are of several frames: {', '.join(sorted(frames))}"
            )
        return next(iter(frames), "")

    def _rectification(self, of: PictureTopic) -> np.ndarray:
        """T_raw_rectified (4, 4)."""
        if len(of.R_raw_rectified) > 1:
            raise InputError(
                f"topic {of.infos.topic}: its R changes; import pictures that are not rectified"
            )
        if abs(of.second_of_pair_m) > 0.0:
            self._warnings.append(
                f"topic {of.infos.topic}: P says the camera is {of.second_of_pair_m:.4g} m beside the first of its "
                "pair; the pose must be its own, not the first one's"
            )
        T = np.eye(4)
        if of.R_raw_rectified:
            T[:3, :3] = of.R_raw_rectified[0]
        return T

    def _none(self, topic: str) -> str:
        why = self._recorded.left_out.only_reason(topic) or "holds no message"
        stamps = (
            " (--by-receipt takes the time at which it was recorded)" if "stamps" in why else ""
        )
        return f"{why}{stamps}"

    def _other_clock(self, number: int) -> float:
        """How much later than poses pictures are recorded after their stamps (s), said where it is
        no transport.
        """
        pictures, poses = self._topics[number], self._pose_topics[number]
        lags = (
            self._recorded.lag_s([pictures]),
            self._recorded.lag_s([poses] if poses else self._tf_topics),
        )
        apart_s = lags[0] - lags[1]
        if Path(self._request.cameras[number].pose).is_file() or not abs(apart_s) > _OTHER_CLOCK_S:
            return 0.0
        if not self._request.by_receipt:
            self._warnings.append(
                f"pictures of {pictures} were recorded {lags[0]:.3f} s after their stamps, its poses {lags[1]:.3f} s: "
                "two clocks? --offset-s shifts the pictures, --by-receipt takes the time of recording"
            )
        return apart_s

    def _uncovered(
        self, topic: str, camera: BagCamera, stamps_s: List[float], why: str, lag_s: float
    ) -> str:
        span_s = camera.source.span_s
        said = f"topic {topic}: no picture has a pose: pictures are from {min(stamps_s):.3f} to {max(stamps_s):.3f}"
        said += (
            f", {camera.source.name} is from {span_s[0]:.3f} to {span_s[1]:.3f}" if span_s else ""
        )
        clock = (
            f"; two clocks {abs(lag_s):.3f} s apart: --offset-s {lag_s:.3f}, or --by-receipt"
            if lag_s
            else ""
        )
        silent = "; --gap-s bridges longer silence" if "silent" in why else ""
        return f"{said} ({why}){clock}{silent}"


def _chosen(
    bags: Sequence[Path],
    request: ImportRequest,
    sources: _Sources,
    recorded: BagContents,
    posed: Sequence[PosedStamp],
    warnings: List[str],
    step: Step,
) -> Tuple[List[PosedStamp], List[np.ndarray]]:
    """The reference first, with 8-bit RGB; pictures that cannot be decoded are replaced by
    others."""
    step("choosing pictures", 0.4)
    left, decoded = list(posed), {}  # type: ignore[var-annotated]
    for _ in range(_ROUNDS):
        chosen = choose(left, request.range_m, request.most, request.reference_s)
        step("reading pictures", 0.5)
        lacking = [p for p in chosen if _key(p) not in decoded]
        decoded.update(_decoded(bags, request, sources, recorded, lacking, warnings))
        bad = {_key(p) for p in lacking if _key(p) not in decoded}
        if not bad:
            break
        left = [p for p in left if _key(p) not in bad]
    else:
        raise InputError(
            "; ".join(["too many pictures are damaged", *recorded.left_out.warnings()])
        )
    images = [decoded[_key(p)] for p in chosen]
    exposure = Exposure.common(i for i in images if i.dtype == np.uint16)
    return chosen, [exposure.to_8_bit(i) for i in images]


def _key(p: PosedStamp) -> Tuple[int, float]:
    return p.camera, p.own_stamp_s


def _decoded(
    bags,
    request: ImportRequest,
    sources: _Sources,
    recorded: BagContents,
    lacking,
    warnings: List[str],
):
    """RGB by key, of those that are whole."""
    found: Dict[Tuple[int, float], np.ndarray] = {}
    numbers = {t: k for k, t in enumerate(sources.pictures)}
    wanted = {_key(p): p for p in lacking}
    for bag in bags:
        try:
            for topic, recorded_s, message in reading.timed_messages(
                bag, lambda t, _: t in numbers, lambda *_: None
            ):
                stamp_s = stamp_of(message, recorded_s, request.by_receipt)
                key = numbers[topic], stamp_s
                if key in wanted and key not in found:
                    try:
                        rgb = compressed_rgb_of if hasattr(message, "format") else rgb_of
                        found[key] = rgb(bag.name, message, wanted[key].intrinsics)
                    except InputError as error:
                        recorded.left_out.add(topic, stamp_s, str(error))
        except BagError:  # said in the first pass
            continue
    return found


def _require_one_size(request: ImportRequest, chosen: Sequence[PosedStamp]) -> None:
    sizes = {
        f"{p.intrinsics.width}x{p.intrinsics.height} ({request.cameras[p.camera].topic})"
        for p in chosen
    }
    if len({s.partition(" ")[0] for s in sizes}) > 1:
        raise InputError(
            f"map needs pictures of one size, these are {', '.join(sorted(sizes))}: import them apart"
        )


def _names(chosen: Sequence[PosedStamp]) -> List[str]:
    """Names pictures by camera and in order of time: camera1_02.png."""
    places: Dict[int, List[float]] = {}
    for p in chosen:
        places.setdefault(p.camera, []).append(p.own_stamp_s)
    return [
        f"camera{p.camera + 1}_{sorted(places[p.camera]).index(p.own_stamp_s) + 1:02d}.png"
        for p in chosen
    ]


def _write(
    out: Path,
    done: Sequence[ImportedPicture],
    images: Sequence[np.ndarray],
    has_priors: bool,
    warnings: List[str],
) -> None:
    with StagedFolder(out) as staged:
        made = staged.folder
        (made / "images").mkdir()
        cameras: Dict[int, PinholeCamera] = {}
        posed: List[PosedImage] = []
        for d, image in zip(done, images):
            camera, shown = _as_colmap(d.posed.intrinsics, image)
            number = next((k for k, known in cameras.items() if known == camera), len(cameras) + 1)
            cameras[number] = camera
            posed.append(PosedImage(d.name, number, d.posed.T_world_cam))
            if not cv2.imwrite(
                str(made / "images" / d.name), cv2.cvtColor(shown, cv2.COLOR_RGB2BGR)
            ):
                raise OutputError(f"{out / 'images' / d.name}: cannot be written")
        if any(any(d.posed.intrinsics.distortion[_COLMAP_COEFFICIENTS:]) for d in done):
            warnings.append(
                "distortion has more than k1, k2, p1, p2: pictures are undistorted and cropped"
            )
        write_model(made, cameras, posed)
        if has_priors:
            sigmas = {d.name: _sigmas(d.covariance) for d in done}
            priors.write_priors(made / priors.FILE, sigmas, 0.0)


def _as_colmap(camera: PinholeCamera, image: np.ndarray) -> Tuple[PinholeCamera, np.ndarray]:
    """Camera and picture as COLMAP's OPENCV model holds them; what it cannot is undistorted,
    without empty borders.
    """
    if not any(camera.distortion[_COLMAP_COEFFICIENTS:]):
        return camera, image
    D, size = np.array(camera.distortion), (camera.width, camera.height)
    K, _ = cv2.getOptimalNewCameraMatrix(camera.K, D, size, 0.0)
    plain = replace(
        camera,
        fx=float(K[0, 0]),
        fy=float(K[1, 1]),
        cx=float(K[0, 2]),
        cy=float(K[1, 2]),
        distortion=(0.0,) * 5,
    )
    return plain, cv2.undistort(image, camera.K, D, None, K)


def _sigmas(covariance: np.ndarray) -> List[float]:
    """x, y, z (m) and roll, pitch, yaw (degrees), as priors.csv has them."""
    sigmas = np.sqrt(covariance.diagonal())
    return [*sigmas[:3], *np.degrees(sigmas[3:])]
