# SPDX-License-Identifier: Apache-2.0
"""Pictures that are not the simulator's ordinary ones: skies, weather, light and cameras as
photographers meet them."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Callable, Dict, List, Tuple

import cv2
import numpy as np

from bench.scenes import (
    ATTITUDE_SIGMA_RAD,
    HORIZONTAL,
    NOISES,
    PLACE_SIGMA_M,
    T_WORLD_HOME,
    PoseNoise,
    SceneName,
    camera_in,
    shoot,
)
from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.sensors.camera import SimulatedCamera
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput, Picture

# grey levels: at the skyline, and brighter by so much at the top
_OVERCAST_GREY, _OVERCAST_STEP = 203.0, 6.0
_SENSOR_GREY = 1.2  # grey levels of noise that a processed picture gets anew
_CLOUD_GREY, _CLOUD_CONTRAST, _CLOUDS_MOVE_DEG = 190.0, 35.0, 2.0
_CLOUD_TINT = np.array([0.97, 1.0, 1.03], np.float32)
_FOG_VISIBILITY_M, _FOG_GREY = 150.0, 195.0  # Koschmieder: 2 % of the contrast is left there
_BACKLIT, _VEIL_GREY, _BLOOM_PX, _BLOOM_GREY = 0.3, 18.0, 25.0, 70.0
# of a D435's colour imager, and of how many poses a picture is put together
_READOUT_S, _STRIPS = 0.02, 24
# standard deviations per axis, of a multirotor that holds
_TURN_RAD_S, _DRIFT_MPS = np.radians(6.0), 0.3
_WRONG_FOCAL = 1.05
EXACT = PoseNoise(1e-7, 1e-7)


@dataclass(frozen=True)
class Case:
    """``true_depth`` HxW (m along the reference's optical axis), NaN where the sky is; ``exact``
    has the true poses."""

    name: str
    given: MapInput
    true_depth: np.ndarray
    exact: MapInput


#: A picture (HxWx3 uint8) with its true depth (m, NaN sky), made into another one; ``random`` draws
#: its noise.
Light = Callable[[np.ndarray, np.ndarray, np.random.Generator], np.ndarray]


def overcast(rgb: np.ndarray, depth: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A sky of one grey, hardly brighter at the top: no texture but the sensor's noise."""
    rows = np.linspace(_OVERCAST_STEP, 0.0, len(rgb))[:, None, None]
    sky = _sky(depth)[..., None]
    return _developed(rgb * (1.0 - sky) + (_OVERCAST_GREY + rows) * sky, random)


def fog(rgb: np.ndarray, depth: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Light that scatters on the way (Koschmieder 1924): contrast falls with depth, the sky is
    fog."""
    left = np.exp(np.log(0.02) / _FOG_VISIBILITY_M * np.nan_to_num(depth, nan=1e6))[..., None]
    return _developed(rgb * left + _FOG_GREY * (1.0 - left), random)


def backlight(rgb: np.ndarray, depth: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The sun behind: what stands is dark, the sky burns out, and its light spreads in the lens."""
    sky = _sky(depth)[..., None]
    bloom = cv2.GaussianBlur(sky, (0, 0), _BLOOM_PX)[..., None] * _BLOOM_GREY
    return _developed(rgb * _BACKLIT * (1.0 - sky) + 255.0 * sky + bloom + _VEIL_GREY, random)


def moving_clouds(given: MapInput, place: SceneName, depths: Dict[str, np.ndarray]) -> MapInput:
    """Clouds that the wind has moved between the pictures, each by up to two degrees of its own: as
    far as they drift in some ten seconds (10 m/s, 1 km up, seen at 20 degrees)."""
    random = np.random.default_rng([*place.words(), 17])
    texture = _cloud_texture(random)
    made: Dict[str, np.ndarray] = {}

    def changed(p: Picture) -> Picture:
        if p.name not in made:
            moved_deg = random.uniform(-_CLOUDS_MOVE_DEG, _CLOUDS_MOVE_DEG, 2) * [1.0, 0.3]
            clouds = _seen_clouds(texture, p, moved_deg)[..., None] * _CLOUD_TINT
            sky = _sky(depths[p.name])[..., None]
            made[p.name] = _developed(p.image * (1.0 - sky) + clouds * sky, random)
        return replace(p, image=made[p.name])

    return _each(given, changed)


def _cloud_texture(random: np.random.Generator) -> np.ndarray:
    """Grey levels over 180 degrees of azimuth (columns) and elevation (rows), ten to a degree:
    noise of all sizes."""
    shape, out = (1800, 1800), np.zeros((1800, 1800), np.float32)
    for cell_deg in (24.0, 12.0, 6.0, 3.0, 1.5, 0.7):
        cells = int(180.0 / cell_deg) + 2
        noise = random.normal(0.0, 1.0, (cells, cells)).astype(np.float32)
        out += cv2.resize(noise, shape, interpolation=cv2.INTER_CUBIC) * np.float32(cell_deg**0.7)
    return _CLOUD_GREY + _CLOUD_CONTRAST * np.tanh(out / out.std())


def _seen_clouds(texture: np.ndarray, p: Picture, moved_deg: np.ndarray) -> np.ndarray:
    """HxW grey levels of the clouds that a picture sees."""
    c, (height, width) = p.camera, p.image.shape[:2]
    x, y = np.meshgrid((np.arange(width) - c.cx) / c.fx, (np.arange(height) - c.cy) / c.fy)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ p.T_home_cam[:3, :3].T
    azimuth_deg = np.degrees(np.arctan2(rays[..., 1], rays[..., 0])) + moved_deg[0]
    elevation_deg = (
        np.degrees(np.arctan2(rays[..., 2], np.hypot(rays[..., 0], rays[..., 1]))) + moved_deg[1]
    )
    at = [10.0 * (azimuth_deg + 90.0), 10.0 * (elevation_deg + 90.0)]
    return cv2.remap(
        texture,
        *(a.astype(np.float32) for a in at),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REFLECT,
    )


LIGHTS: Dict[str, Light] = {"overcast sky": overcast, "fog": fog, "backlight": backlight}


def cases(place: SceneName, foreign: SceneName) -> List[Case]:
    """All cases at one place; ``foreign`` is where a picture that was pasted in is from."""
    scene, elsewhere = shoot(place, HORIZONTAL), shoot(foreign, HORIZONTAL)
    given, exact = scene.given(HORIZONTAL, NOISES[0]), scene.given(HORIZONTAL, EXACT)
    changes: Dict[str, Callable[[MapInput], MapInput]] = {
        name: partial(lit, place=place, depths=scene.depths, light=light)
        for name, light in LIGHTS.items()
    }
    changes["moving clouds"] = partial(moving_clouds, place=place, depths=scene.depths)
    changes["focal length 5 % high"] = partial(_with_focal, factor=_WRONG_FOCAL)
    changes["one foreign picture"] = partial(_pasted, which=[1], others=elsewhere.others)
    found = [
        Case(name, change(given), scene.true_depth, change(exact))
        for name, change in changes.items()
    ]
    return [*found, Case("rolling shutter", *_rolling(place))]


def foreign(place: SceneName, elsewhere: SceneName) -> MapInput:
    """A reference and pictures of another place, with the poses of a session."""
    scene, other = shoot(place, HORIZONTAL), shoot(elsewhere, HORIZONTAL)
    return _pasted(scene.given(HORIZONTAL, NOISES[0]), range(len(HORIZONTAL)), other.others)


def lit(given: MapInput, place: SceneName, depths: Dict[str, np.ndarray], light: Light) -> MapInput:
    """Every picture in another light; ``depths`` by picture."""
    random = np.random.default_rng([*place.words(), 11])
    made: Dict[str, np.ndarray] = {}

    def changed(p: Picture) -> Picture:
        if p.name not in made:
            made[p.name] = light(p.image, depths[p.name], random)
        return replace(p, image=made[p.name])

    return _each(given, changed)


def _sky(depth: np.ndarray) -> np.ndarray:
    """HxW float32, 1 in the sky, smooth at the skyline as a lens makes it."""
    return cv2.GaussianBlur((~np.isfinite(depth)).astype(np.float32), (0, 0), 0.6)


def _developed(values: np.ndarray, random: np.random.Generator) -> np.ndarray:
    noisy = values + random.normal(0.0, _SENSOR_GREY, values.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def _each(given: MapInput, changed: Callable[[Picture], Picture]) -> MapInput:
    configurations = [
        replace(
            c, references=[changed(p) for p in c.references], others=[changed(p) for p in c.others]
        )
        for c in given.configurations
    ]
    return replace(given, configurations=configurations)


def _with_focal(given: MapInput, factor: float) -> MapInput:
    def changed(p: Picture) -> Picture:
        c = p.camera
        return replace(
            p, camera=PinholeCamera(c.width, c.height, c.fx * factor, c.fy * factor, c.cx, c.cy)
        )

    return _each(given, changed)


def _pasted(given: MapInput, which, others: List[Picture]) -> MapInput:
    """The others' pictures at some of the configurations, with the poses as they were."""
    configurations = list(given.configurations)
    for i in which:
        pasted = [replace(p, image=others[i].image) for p in configurations[i].others]
        configurations[i] = replace(configurations[i], others=pasted)
    return replace(given, configurations=configurations)


def _rolling(place: SceneName) -> Tuple[MapInput, np.ndarray, MapInput]:
    """Rows read one after the other while the vehicle turns and drifts; poses are of the middle
    row."""
    random = np.random.default_rng([*place.words(), 13])
    camera = camera_in(place)

    def take(number: int, xyz) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        p = np.asarray(xyz) + random.normal(0.0, PLACE_SIGMA_M, 3)
        rpy = random.normal(0.0, ATTITUDE_SIGMA_RAD, 3)
        turn, drift = random.normal(0.0, _TURN_RAD_S, 3), random.normal(0.0, _DRIFT_MPS, 3)
        return _shot_by_rows(camera, float(number), p, rpy, turn, drift)

    noise = NOISES[0]
    image, depth, T = take(0, [0.0, 0.0, 0.0])
    reference = Picture("uav1/reference", "uav1", 0.0, image, camera.model, T)
    configurations, exact = [], []
    for number, (axis, b) in enumerate(HORIZONTAL, 1):
        image, _, T = take(number, [0.0, -b, 0.0])
        error = transforms.from_xyz_rpy(
            random.normal(0.0, noise.prior.position_sigma_m(b), 3),
            random.normal(0.0, noise.rotation_rad, 3),
        )
        other = Picture(f"uav2/{axis} {b:g} m", "uav2", 0.0, image, camera.model, T)
        exact.append(
            ConfigurationInput(Configuration(axis, b, 0.0, other.name), [reference], [other])
        )
        configurations.append(replace(exact[-1], others=[replace(other, T_home_cam=T @ error)]))
    given = MapInput("session", configurations, prior=noise.prior)
    return given, depth, replace(given, configurations=exact)


def _shot_by_rows(camera: SimulatedCamera, stamp_s: float, p, rpy, turn, drift):
    """A picture put together of strips from where the camera was as each was read; depth and pose
    of the middle."""
    edges = np.linspace(0, camera.model.height, _STRIPS + 1).astype(int)
    rgb, depth, T_home_cam = None, None, None
    for first, last in zip(edges[:-1], edges[1:]):
        late_s = _READOUT_S * (0.5 * (first + last) / camera.model.height - 0.5)
        T_home_body = transforms.from_xyz_rpy(p + late_s * drift, rpy + late_s * turn)
        shot = camera.shoot(stamp_s, T_WORLD_HOME @ T_home_body)
        rgb = shot.rgb.copy() if rgb is None else rgb
        rgb[first:last] = shot.rgb[first:last]
    shot = camera.shoot(stamp_s, T_WORLD_HOME @ transforms.from_xyz_rpy(p, rpy))
    depth, T_home_cam = shot.depth, transforms.invert(T_WORLD_HOME) @ shot.T_world_cam
    return rgb, depth, T_home_cam
