# SPDX-License-Identifier: Apache-2.0
"""The narrow camera on a gimbal: a vehicle's tags drawn as they move while the shutter is open;
noise, delay."""

from dataclasses import dataclass
from typing import Callable, List, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.gimbal.gimbal import turned
from fcsv_sim.render.light import SUN
from fcsv_sim.render.tag import tag_bitmap
from fcsv_tracking.gimbal.config import BodyTag

_MODULE_PX = 16  # of a tag's module in its texture
_BODY_HALF_M = np.array([0.049, 0.046, 0.0205])  # a Tello
_MOST_SUBFRAMES, _LEAST_SUBFRAMES, _SUBFRAME_PX = 24, 4, 1.5
_TEXTURE_PX = 10 * _MODULE_PX
_PANORAMA = (2304, 4096)
_NOISES = 2

Pose = Callable[[float], np.ndarray]


@dataclass(frozen=True)
class GimbalCameraParameters:
    """The thesis's camera (table 4.2): 1920 x 1080, 21.5 degrees across. Times in seconds; noise of
    255."""

    width: int = 1920
    height: int = 1080
    horizontal_fov_deg: float = 21.5
    rate_hz: float = 30.0
    exposure_s: float = 0.002
    latency_s: float = 0.05  # mid-exposure to the picture's arrival
    latency_jitter_s: float = 0.005
    stamp_s: float = 0.001  # standard deviation of a constant error of all stamps
    stamp_jitter_s: float = 0.0005
    noise: float = 2.5
    blur_px: float = 0.6  # the lens
    tag_m: float = 0.0005  # how the tags sit on the body other than told
    tag_deg: float = 0.3

    @property
    def model(self) -> PinholeCamera:
        return PinholeCamera.from_fov(self.width, self.height, np.radians(self.horizontal_fov_deg))


class _Face:
    """A tag with its white border, as a texture in its own plane."""

    def __init__(self, tag: BodyTag, T_body_tag: np.ndarray):
        self.tag, self.T_body_tag = tag, T_body_tag
        white = np.kron(tag_bitmap(tag.id), np.ones((_MODULE_PX, _MODULE_PX), np.float32))
        # that it is there, and how white
        self.texture = np.stack([np.ones_like(white), white], axis=-1)
        module_m = tag.size_m / 8.0
        texel_m = module_m / _MODULE_PX
        #: Texture pixel (centres at whole numbers) to the tag's plane (m).
        self.A = np.array(
            [
                [texel_m, 0, 0.5 * texel_m - 5 * module_m],
                [0, texel_m, 0.5 * texel_m - 5 * module_m],
                [0, 0, 1],
            ]
        )
        self.half_m = 5 * module_m

    @property
    def corners(self) -> np.ndarray:
        h = self.half_m
        return transforms.apply(
            self.T_body_tag, np.array([[-h, -h, 0], [h, -h, 0], [h, h, 0], [-h, h, 0.0]])
        )


def facing(T_cam_tag: np.ndarray) -> float:
    """How a tag is seen: the cosine of the angle between its face and the line of sight; one: face
    on."""
    return float(T_cam_tag[:3, 2] @ T_cam_tag[:3, 3] / np.linalg.norm(T_cam_tag[:3, 3]))


class GimbalCamera:
    """shoot() in order of time. Poses are functions of time: camera and body move during the
    exposure."""

    def __init__(self, tags: Sequence[BodyTag], parameters: GimbalCameraParameters, seed: int):
        self._p, self.model = parameters, parameters.model
        random = self._random = np.random.default_rng([seed, 22])
        self._faces = [
            _Face(t, turned(t.T_body_tag, parameters.tag_m, parameters.tag_deg, random))
            for t in tags
        ]
        self._late_s = random.normal(0.0, parameters.stamp_s)
        self._panorama = np.pad(
            _clutter(random), ((0, self.model.height), (0, self.model.width)), "wrap"
        )
        size = (self.model.height, self.model.width)
        pool = [
            parameters.noise * random.standard_normal(size, dtype=np.float32)
            for _ in range(_NOISES)
        ]
        self._noises = [np.clip(np.round(n), -127, 127).astype(np.int8) for n in pool]

    def arrival_s(self, true_s: float) -> float:
        """When a picture of mid-exposure ``true_s`` arrives."""
        return true_s + self._p.latency_s + abs(self._random.normal(0.0, self._p.latency_jitter_s))

    def stamp_s(self, true_s: float) -> float:
        """What the driver says of it."""
        return true_s + self._late_s + self._random.normal(0.0, self._p.stamp_jitter_s)

    def shoot(self, true_s: float, T_ground_cam: Pose, T_ground_body: Pose) -> np.ndarray:
        """The picture (HxW uint8) of mid-exposure ``true_s``, which no node is told."""
        gray = self._background(true_s, T_ground_cam)
        moments = true_s + self._p.exposure_s * np.array([-0.5, 0.0, 0.5])
        ends = [transforms.invert(T_ground_cam(t)) @ T_ground_body(t) for t in moments]
        if all(T[2, 3] > 0.3 for T in ends):
            self._draw(gray, true_s, T_ground_cam, T_ground_body, ends)
        gray = cv2.add(gray, self._noises[int(self._random.integers(_NOISES))], dtype=cv2.CV_8U)
        return gray

    def tags_in(self, T_cam_body: np.ndarray) -> List[Tuple[BodyTag, np.ndarray]]:
        """Tags that face the camera (within 72 degrees) and lie in the picture whole, and their
        true T_cam_tag."""
        found = []
        for face in self._faces:
            uv = self.model.project(transforms.apply(T_cam_body, face.corners))
            T = T_cam_body @ face.T_body_tag
            inside = (uv > 0).all() and (uv < [self.model.width - 1, self.model.height - 1]).all()
            if facing(T) > np.cos(np.radians(72.0)) and inside:
                found.append((face.tag, T))
        return found

    def _background(self, true_s: float, T_ground_cam: Pose) -> np.ndarray:
        """Clutter that passes by as the camera turns, smeared along its way."""
        m, half = self.model, 0.5 * self._p.exposure_s
        places = [_direction_px(T_ground_cam(t), m.fx) for t in (true_s - half, true_s + half)]
        u, v = (int(round(c)) for c in 0.5 * (places[0] + places[1]))
        u, v = u % _PANORAMA[1], v % _PANORAMA[0]
        gray = self._panorama[v : v + m.height, u : u + m.width].copy()
        smear = np.abs(places[1] - places[0]).astype(int)
        if smear.max() > 2:
            gray = cv2.blur(gray, (int(smear[0]) | 1, int(smear[1]) | 1))
        return gray

    def _draw(
        self, gray: np.ndarray, true_s: float, T_ground_cam: Pose, T_ground_body: Pose, ends
    ) -> None:
        m = self.model
        hull = np.concatenate([f.corners for f in self._faces] + [_body_corners()])
        uv = np.concatenate([m.project(transforms.apply(T, hull)) for T in ends])
        if not np.isfinite(uv).all():
            return
        low = np.maximum(np.floor(uv.min(0)) - 4, 0).astype(int)
        high = np.minimum(np.ceil(uv.max(0)) + 5, [m.width, m.height]).astype(int)
        if (high <= low).any():
            return
        blur_px = float(
            np.linalg.norm(m.project(ends[0][None, :3, 3]) - m.project(ends[2][None, :3, 3]))
        )
        count = int(np.clip(np.ceil(blur_px / _SUBFRAME_PX), _LEAST_SUBFRAMES, _MOST_SUBFRAMES))
        window = gray[low[1] : high[1], low[0] : high[0]]
        behind = window.astype(np.float32)
        total = np.zeros_like(behind)
        for k in range(count):
            t = true_s + self._p.exposure_s * ((k + 0.5) / count - 0.5)
            T_G_D = T_ground_body(t)
            total += self._subframe(
                behind, transforms.invert(T_ground_cam(t)) @ T_G_D, T_G_D[:3, :3], low
            )
        total /= count
        if self._p.blur_px > 0:
            total = cv2.GaussianBlur(total, (5, 5), self._p.blur_px)
        window[:] = np.clip(total + 0.5, 0, 255).astype(np.uint8)

    def _subframe(
        self, behind: np.ndarray, T_cam_body: np.ndarray, R_ground_body: np.ndarray, low
    ) -> np.ndarray:
        out = behind.copy()
        K = self.model.K
        K[:2, 2] -= low
        corners = transforms.apply(T_cam_body, _body_corners()) @ K.T
        outline = cv2.convexHull((corners[:, :2] / corners[:, 2:]).astype(np.float32))
        cv2.fillConvexPoly(out, np.round(outline * 16).astype(np.int32), 45.0, cv2.LINE_8, 4)
        placed = sorted(
            ((T_cam_body @ f.T_body_tag, f) for f in self._faces), key=lambda pair: -pair[0][2, 3]
        )
        for T_cam_tag, face in placed:
            if T_cam_tag[:3, 2] @ T_cam_tag[:3, 3] <= 0:
                continue  # its back
            normal = -R_ground_body @ face.T_body_tag[:3, 2]
            light = 0.55 + 0.45 * max(0.0, float(normal @ SUN))
            H = K @ T_cam_tag[:, [0, 1, 3]][:3] @ face.A
            _paste(out, face, H, light)
        return out


def _paste(out: np.ndarray, face: _Face, H: np.ndarray, light: float) -> None:
    """Lay a face over a picture; H takes its texture's pixels to the picture's."""
    ends = H @ np.array(
        [[0, _TEXTURE_PX, _TEXTURE_PX, 0], [0, 0, _TEXTURE_PX, _TEXTURE_PX], [1, 1, 1, 1]], float
    )
    uv = (ends[:2] / ends[2]).T
    low = np.maximum(np.floor(uv.min(0)) - 2, 0).astype(int)
    high = np.minimum(np.ceil(uv.max(0)) + 3, out.shape[1::-1]).astype(int)
    if (high <= low).any():
        return
    shift = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1.0]])
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    warped = cv2.warpPerspective(face.texture, shift @ H, size, flags=cv2.INTER_LINEAR)
    mask, white = warped[..., 0], warped[..., 1]
    part = out[low[1] : high[1], low[0] : high[0]]
    part *= 1.0 - mask
    part += 12.0 * mask + 200.0 * light * white


def _body_corners() -> np.ndarray:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    return signs * _BODY_HALF_M


def _direction_px(T_ground_cam: np.ndarray, focal_px: float) -> np.ndarray:
    """Where in the panorama the camera looks."""
    x, y, z = T_ground_cam[:3, 2]
    return focal_px * np.array([-np.arctan2(y, x), -np.arctan2(z, np.hypot(x, y))])


def _clutter(random: np.random.Generator) -> np.ndarray:
    """A wall of soft blotches and some edges (uint8)."""
    height, width = _PANORAMA
    coarse = random.uniform(70, 190, (height // 64, width // 64)).astype(np.float32)
    wall = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    for _ in range(120):
        u, v, w, h = (
            random.integers(0, width),
            random.integers(0, height),
            *random.integers(20, 300, 2),
        )
        cv2.rectangle(
            wall, (int(u), int(v)), (int(u + w), int(v + h)), float(random.uniform(40, 220)), -1
        )
    return np.clip(cv2.GaussianBlur(wall, (5, 5), 1.2), 0, 255).astype(np.uint8)
