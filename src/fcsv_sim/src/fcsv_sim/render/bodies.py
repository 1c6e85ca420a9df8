# SPDX-License-Identifier: Apache-2.0
"""Other vehicles in the picture: hull, arms, motors, spinning rotors and the tag; and things of
boxes that move; with occlusion both ways."""

import math
from dataclasses import dataclass
from typing import Sequence, Tuple, Union

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_sim.render import compiled
from fcsv_sim.render.light import SUN, haze, respond
from fcsv_sim.render.tag import tag_bitmap
from fcsv_tracking.gimbal.config import BodyTag

compiled.drop_stale(__file__, "light")

_SAMPLES = 16
_NOTHING = 1e30  # distance of what is not hit
_MOTORS = [(x, y) for x in (-0.088, 0.088) for y in (-0.088, 0.088)]
_ROTOR_Z, _ROTOR_RADIUS, _ROTOR_OPACITY = 0.055, 0.064, 0.35
_S0, _S1, _S2 = (float(v) for v in SUN)


@dataclass(frozen=True)
class RenderedBody:
    """A vehicle at a place: T_world_body."""

    geometry: VehicleGeometry
    T_world_body: np.ndarray


@dataclass(frozen=True)
class BoxedThing:
    """Boxes (K, 11) of any thing at a place: T_world_body; all of it within ``radius_m`` of its
    origin. ``tags`` sit on it."""

    boxes: np.ndarray
    T_world_body: np.ndarray
    radius_m: float
    tags: Tuple[BodyTag, ...] = ()


Drawn = Union[RenderedBody, BoxedThing]


def _parts() -> np.ndarray:
    """Boxes (K, 11) in the body: centre, half size, cosine and sine of the yaw, colour; with tag
    0.3 x 0.3 x 0.2 m."""
    dark, grey, red = (0.022, 0.022, 0.025), (0.10, 0.10, 0.11), (0.35, 0.03, 0.02)
    parts = [
        ((-0.01, 0.0, 0.0), (0.10, 0.045, 0.028), 0.0, dark),
        ((-0.01, 0.0, 0.045), (0.07, 0.03, 0.02), 0.0, (0.05, 0.05, 0.14)),
        ((-0.125, 0.0, 0.02), (0.026, 0.012, 0.012), 0.0, grey),
        ((0.105, 0.0, 0.03), (0.012, 0.045, 0.013), 0.0, grey),
        ((0.06, 0.0, -0.045), (0.012, 0.05, 0.012), 0.0, grey),
    ]
    for x, y in _MOTORS:
        parts.append(((x / 2, y / 2, 0.01), (0.062, 0.011, 0.006), math.atan2(y, x), dark))
        parts.append(((x, y, 0.03), (0.014, 0.014, 0.022), 0.0, red if x > 0 else grey))
        parts.append(((x, y, -0.04), (0.006, 0.006, 0.045), 0.0, dark))
    return np.array(
        [[*c, *h, math.cos(yaw), math.sin(yaw), *colour] for c, h, yaw, colour in parts]
    )


def _box_corners(boxes: np.ndarray) -> np.ndarray:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    local = signs * boxes[:, None, 3:6]
    c, s = boxes[:, None, 6], boxes[:, None, 7]
    turned = np.stack(
        [
            c * local[..., 0] - s * local[..., 1],
            s * local[..., 0] + c * local[..., 1],
            local[..., 2],
        ],
        -1,
    )
    return turned + boxes[:, None, :3]


_BOXES = _parts()
_BOX_CORNERS = _box_corners(_BOXES)
_SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
_REACH = 0.088 + _ROTOR_RADIUS
_ROTOR_CORNERS = np.concatenate([_SQUARE * _REACH + [0, 0, _ROTOR_Z - e] for e in (0.0, 1e-3)])


def sample_offsets(count: int = _SAMPLES) -> np.ndarray:
    """Places in a pixel (count,2): every row and every column of a count x count grid is used once,
    so that an edge along an axis is resolved to 1/count px; mean zero."""
    bits = int(math.log2(count))
    reverse = np.array([int(format(i, f"0{bits}b")[::-1], 2) for i in range(count)])
    return (np.stack([np.arange(count), reverse], -1) + 0.5) / count - 0.5


_OFFSETS = sample_offsets()


def draw_bodies(
    bodies: Sequence[Drawn],
    T_world_cam: np.ndarray,
    camera: PinholeCamera,
    directions: np.ndarray,
    exposure: float,
    values: np.ndarray,
    depth: np.ndarray,
) -> None:
    """Draw into values (H,W,3) and depth (H,W; NaN where there is nothing), farthest first."""
    placed = [(transforms.invert(T_world_cam) @ b.T_world_body, b) for b in bodies]
    for T_cam_body, body in sorted(placed, key=lambda p: -p[0][2, 3]):
        thing = isinstance(body, BoxedThing)
        if T_cam_body[2, 3] < 2 * (body.radius_m if thing else body.geometry.radius_m):
            continue  # behind the camera, or in it
        if thing:
            _draw_thing(body, T_cam_body, camera, directions, exposure, values, depth)
            for tag in body.tags:
                _draw_tag(tag, body, T_cam_body, camera, directions, exposure, values, depth)
            continue
        T_body_tag, size_m = body.geometry.T_body_tag, body.geometry.tag_size_m
        plate = transforms.apply(T_body_tag, _SQUARE * size_m * 0.625)
        corners = np.concatenate([_BOX_CORNERS, np.tile(plate, (1, 2, 1)), _ROTOR_CORNERS[None]])
        windows = _windows(T_cam_body, corners, camera)
        if windows is None:
            continue
        _draw(
            values,
            depth,
            directions,
            windows,
            _OFFSETS,
            transforms.invert(T_cam_body),
            body.T_world_body[:3, :3],
            transforms.invert(T_body_tag),
            _BOXES,
            tag_bitmap(body.geometry.tag_id),
            size_m,
            exposure,
        )


def _draw_thing(thing: BoxedThing, T_cam_body, camera, directions, exposure, values, depth) -> None:
    """Draws it as a body without rotors and tag: their windows are empty."""
    windows = _windows(T_cam_body, _box_corners(thing.boxes), camera)
    if windows is None:
        return
    windows = np.concatenate([windows[:-1], np.zeros((2, 4), np.int64), windows[-1:]])
    nowhere, blank = np.eye(4), np.zeros((10, 10), np.float32)
    _draw(
        values,
        depth,
        directions,
        windows,
        _OFFSETS,
        transforms.invert(T_cam_body),
        thing.T_world_body[:3, :3].copy(),
        nowhere,
        thing.boxes,
        blank,
        1.0,
        exposure,
    )


def _draw_tag(
    tag: BodyTag, thing: BoxedThing, T_cam_body, camera, directions, exposure, values, depth
) -> None:
    """Draws a board before the thing, as a body without boxes and rotors."""
    plate = transforms.apply(tag.T_body_tag, _SQUARE * tag.size_m * 0.625)
    windows = _windows(T_cam_body, np.tile(plate, (1, 2, 1)), camera)
    if windows is None:
        return
    _draw(
        values,
        depth,
        directions,
        np.stack([windows[0], np.zeros(4, np.int64), windows[1]]),
        _OFFSETS,
        transforms.invert(T_cam_body),
        thing.T_world_body[:3, :3].copy(),
        transforms.invert(tag.T_body_tag),
        thing.boxes[:0],
        tag_bitmap(tag.id),
        tag.size_m,
        exposure,
    )


def _windows(T_cam_body, corners, camera: PinholeCamera):
    """Pixel rectangles (u0, v0, u1, v1) of every part's corners (K, 8, 3), and all together, or
    None where the body is not in the picture: what cannot be seen in a pixel is not tried there."""
    p_cam = transforms.apply(T_cam_body, corners.reshape(-1, 3))
    uv = camera.project(p_cam).reshape(len(corners), -1, 2)
    low, high = np.floor(uv.min(1)) - 1, np.ceil(uv.max(1)) + 2
    rectangles = np.concatenate([low, high], 1)
    rectangles = np.concatenate([rectangles, [[*low.min(0), *high.max(0)]]])
    rectangles = np.clip(rectangles, 0, [camera.width, camera.height] * 2)
    seen = np.isfinite(uv).all() and (rectangles[-1, 2:] > rectangles[-1, :2]).all()
    return rectangles.astype(np.int64) if seen else None


@compiled.function
def _hit_box(box, o, d):
    """Nearest t > 0 of a ray and a box turned about z; and the face's normal (body frame). t = inf:
    none."""
    c, s = box[6], box[7]
    qx, qy = o[0] - box[0], o[1] - box[1]
    ox, oy, oz = c * qx + s * qy, c * qy - s * qx, o[2] - box[2]
    dx, dy, dz = c * d[0] + s * d[1], c * d[1] - s * d[0], d[2]
    low, high, axis, sign = 0.0, 1e30, 0, 1.0
    for k in range(3):
        a, b, h = (ox, dx, box[3]) if k == 0 else (oy, dy, box[4]) if k == 1 else (oz, dz, box[5])
        if abs(b) < 1e-12:
            b = 1e-12
        t0, t1 = (-h - a) / b, (h - a) / b
        if t0 > t1:
            t0, t1 = t1, t0
        if t0 > low:
            low, axis, sign = t0, k, (-1.0 if b > 0 else 1.0)
        high = min(high, t1)
    if low > high or low <= 0.0:
        return _NOTHING, 0.0, 0.0, 0.0
    if axis == 2:
        return low, 0.0, 0.0, sign
    return (low, c * sign, s * sign, 0.0) if axis == 0 else (low, -s * sign, c * sign, 0.0)


@compiled.function
def _trace(o, d, boxes, tried, count, with_tag, T_tag_body, bitmap, size_m, light):
    """Nearest part: t, r, g, b (radiance before haze). light: sun's direction in the body frame,
    then world's up."""
    best, r, g, b = _NOTHING, 0.0, 0.0, 0.0
    nx, ny, nz = 0.0, 0.0, 0.0
    for k in range(count):
        i = tried[k]
        t, x, y, z = _hit_box(boxes[i], o, d)
        if t < best:
            best, nx, ny, nz, r, g, b = t, x, y, z, boxes[i, 8], boxes[i, 9], boxes[i, 10]
    oz = (
        T_tag_body[2, 0] * o[0]
        + T_tag_body[2, 1] * o[1]
        + T_tag_body[2, 2] * o[2]
        + T_tag_body[2, 3]
    )
    dz = T_tag_body[2, 0] * d[0] + T_tag_body[2, 1] * d[1] + T_tag_body[2, 2] * d[2]
    if with_tag and abs(dz) > 1e-9:
        t = -oz / dz
        if 0.0 < t < best:
            x, y, z = o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]
            u = (
                T_tag_body[0, 0] * x
                + T_tag_body[0, 1] * y
                + T_tag_body[0, 2] * z
                + T_tag_body[0, 3]
            )
            v = (
                T_tag_body[1, 0] * x
                + T_tag_body[1, 1] * y
                + T_tag_body[1, 2] * z
                + T_tag_body[1, 3]
            )
            column, row = (
                int(math.floor(u / size_m * 8.0 + 5.0)),
                int(math.floor(v / size_m * 8.0 + 5.0)),
            )
            if 0 <= column < 10 and 0 <= row < 10:
                front = -1.0 if dz > 0.0 else 1.0
                nx, ny, nz = (
                    front * T_tag_body[2, 0],
                    front * T_tag_body[2, 1],
                    front * T_tag_body[2, 2],
                )
                tone = 0.03 + 0.67 * bitmap[row, column] if dz > 0.0 else 0.3
                best, r, g, b = t, tone, tone, tone
    sun = 1.55 * max(0.0, nx * light[0] + ny * light[1] + nz * light[2])
    up = 0.5 + 0.5 * (nx * light[3] + ny * light[4] + nz * light[5])
    return (
        best,
        r * (sun + 0.3 + 0.25 * up),
        g * (0.95 * sun + 0.3 + 0.3 * up),
        b * (0.85 * sun + 0.3 + 0.4 * up),
    )


@compiled.function
def _rotor_veil(o, d, best):
    """How much light the spinning rotors in front of ``best`` let through."""
    if abs(d[2]) < 1e-9:
        return 1.0
    t = (_ROTOR_Z - o[2]) / d[2]
    if t <= 0.0 or t > best:
        return 1.0
    x, y = abs(o[0] + t * d[0]) - 0.088, abs(o[1] + t * d[1]) - 0.088
    return 1.0 - _ROTOR_OPACITY if x * x + y * y < _ROTOR_RADIUS * _ROTOR_RADIUS else 1.0


@compiled.function
def _light_in_body(R_world_body):
    """The sun's direction and the world's up, in the body."""
    light = np.zeros(6)
    for k in range(3):
        light[k] = R_world_body[0, k] * _S0 + R_world_body[1, k] * _S1 + R_world_body[2, k] * _S2
        light[3 + k] = R_world_body[2, k]
    return light


@compiled.function
def _inside(window, u, v):
    return window[0] <= u < window[2] and window[1] <= v < window[3]


@compiled.function
def _ray(directions, u, v, du, dv, R, d):
    """Direction in the body of a place (du, dv) off the centre of a pixel, between its neighbours'
    directions."""
    height, width = directions.shape[:2]
    ua, ub, va, vb = max(u - 1, 0), min(u + 1, width - 1), max(v - 1, 0), min(v + 1, height - 1)
    a, b = du / (ub - ua), dv / (vb - va)
    x = directions[v, u, 0] + a * (directions[v, ub, 0] - directions[v, ua, 0])
    x += b * (directions[vb, u, 0] - directions[va, u, 0])
    y = directions[v, u, 1] + a * (directions[v, ub, 1] - directions[v, ua, 1])
    y += b * (directions[vb, u, 1] - directions[va, u, 1])
    for k in range(3):
        d[k] = R[k, 0] * x + R[k, 1] * y + R[k, 2]


@compiled.kernel
def _draw(
    values,
    depth,
    directions,
    windows,
    offsets,
    T_body_cam,
    R_world_body,
    T_tag_body,
    boxes,
    bitmap,
    size_m,
    exposure,
):
    """Area-sampled: every sample is the body, seen through its rotors, or what the picture shows
    behind it."""
    o, R = T_body_cam[:3, 3].copy(), T_body_cam[:3, :3].copy()
    light, d, sums = _light_in_body(R_world_body), np.zeros(3), np.zeros(3)
    tried, parts = np.zeros(len(boxes), np.int64), len(boxes)
    whole = windows[parts + 2]
    for v in range(whole[1], whole[3]):
        for u in range(whole[0], whole[2]):
            count = 0
            for i in range(parts):
                if _inside(windows[i], u, v):
                    tried[count] = i
                    count += 1
            with_tag, veiled = _inside(windows[parts], u, v), _inside(windows[parts + 1], u, v)
            if count == 0 and not with_tag and not veiled:
                continue
            behind = _NOTHING if np.isnan(depth[v, u]) else depth[v, u]
            sums[:] = 0.0
            for s in range(len(offsets)):
                _ray(directions, u, v, offsets[s, 0], offsets[s, 1], R, d)
                t, r, g, b = _trace(
                    o, d, boxes, tried, count, with_tag, T_tag_body, bitmap, size_m, light
                )
                veil = _rotor_veil(o, d, min(t, behind)) if veiled else 1.0
                if t < behind:
                    r, g, b = haze(r, g, b, t)
                    sums[0] += veil * respond(r * exposure)
                    sums[1] += veil * respond(g * exposure)
                    sums[2] += veil * respond(b * exposure)
                else:
                    for k in range(3):
                        sums[k] += veil * values[v, u, k]
            for k in range(3):
                values[v, u, k] = sums[k] / len(offsets)
            _ray(directions, u, v, 0.0, 0.0, R, d)
            t = _trace(o, d, boxes, tried, count, with_tag, T_tag_body, bitmap, size_m, light)[0]
            if t < behind:
                depth[v, u] = t
