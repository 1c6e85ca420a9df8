# SPDX-License-Identifier: Apache-2.0
"""Pairs as a stereo rig takes them, with true depth: things 1 to 10 m away, streets, and the real
pair in three units.

Cameras of the drawn pairs are 10 to 30 cm (near), 25 cm (wide lens) and 54 cm (street) apart and
not turned.
"""

from dataclasses import dataclass, replace
from typing import Iterator, List, Tuple

import numpy as np

from bench.hard_cases import Case
from bench.photographs import motorcycle
from bench.real import RIG_OPTIONS, measured, table
from bench.scenes import R_BODY_CAM, SceneName
from fcsv_geometry import transforms
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.world.town import Town
from fcsv_stereo.model import (
    RIG,
    Configuration,
    ConfigurationInput,
    InputKind,
    MapInput,
    Picture,
    PosePrior,
)
from fcsv_stereo.posed.unit_of_length import in_unit

_TRIES = 60
_UNITS = (0.1, 1.0, 10.0)


@dataclass(frozen=True)
class _Kind:
    """A camera (size in px, angle of view), baselines (m), headings (deg, either side) and the
    depths that a place must have (m): least second percentile, range of the median, most of the
    95th percentile."""

    size: Tuple[int, int]
    fov_deg: float
    baseline_m: Tuple[float, float]
    heading_deg: Tuple[float, float]
    depths_m: Tuple[float, Tuple[float, float], float]


_KINDS = {
    "near": _Kind((640, 480), 56.0, (0.1, 0.3), (50.0, 110.0), (1.0, (2.0, 9.0), 60.0)),
    "street": _Kind((1242, 375), 81.5, (0.54, 0.54), (0.0, 10.0), (2.0, (6.0, np.inf), np.inf)),
    "wide lens": _Kind((640, 480), 90.0, (0.25, 0.25), (0.0, 10.0), (2.0, (6.0, np.inf), np.inf)),
}
_PLACES = {
    "near": (
        ("street", 31),
        ("village", 32),
        ("field", 34),
        ("street", 33),
        ("village", 35),
        ("plain", 36),
    ),
    "street": (("street", 41), ("village", 42)),
    "wide lens": (("street", 43), ("field", 44)),
}


def measure_rigs() -> List[str]:
    """The page's lines: each pair with nothing said of its poses, and with ``--rig``; its poses err
    as that says."""
    rows, by_kind = [], {}
    for case in drawn():
        for words, options, prior in (
            ("nothing said", None, PosePrior()),
            ("--rig", RIG_OPTIONS, RIG),
        ):
            seen = replace(case, given=_with_errors(case.given, prior, case.name))
            rows.append(measured(seen, words, by_kind, options))
            print(f"    {rows[-1]}", flush=True)
    pair = motorcycle()
    for unit in _UNITS if pair is not None else ():
        given, exact = (in_unit(g, 1.0 / unit) for g in (pair.given, pair.exact))
        longer = replace(
            pair, given=given, exact=exact, true_depth=pair.true_depth * np.float32(unit)
        )
        rows.append(measured(longer, f"poses times {unit:g}", by_kind))
        print(f"    {rows[-1]}", flush=True)
    return table(rows)


def drawn() -> Iterator[Case]:
    """Pairs of the simulator's worlds, with exact poses."""
    for kind, places in _PLACES.items():
        for place in places:
            yield _draw(kind, SceneName(*place))


def _draw(kind: str, name: SceneName) -> Case:
    """The first place of a seeded row of them whose depths are the kind's."""
    k, random = _KINDS[kind], np.random.default_rng([*name.words(), len(kind)])
    parameters = CameraParameters(
        width=k.size[0],
        height=k.size[1],
        horizontal_fov_deg=k.fov_deg,
        distortion=(0.0,) * 5,
        mount_deg=0.0,
    )
    camera = SimulatedCamera(
        Renderer(Town.generate(name.seed, name.world)), R_BODY_CAM, parameters, name.seed
    )
    for _ in range(_TRIES):
        p = [random.uniform(5.0, 60.0), random.uniform(-6.0, 6.0), random.uniform(1.2, 2.2)]
        yaw_rad = np.radians(random.choice([-1.0, 1.0]) * random.uniform(*k.heading_deg))
        baseline_m = random.uniform(*k.baseline_m)
        T_world_body = transforms.from_xyz_yaw(p, yaw_rad)
        here = camera.shoot(0.0, T_world_body)
        if _fits(here.depth, k):
            there = camera.shoot(
                1.0,
                T_world_body @ transforms.transform(np.eye(3), np.array([0.0, -baseline_m, 0.0])),
            )
            return _case(f"{kind}, {name}, {baseline_m * 100:.0f} cm", here, there, camera)
    raise ValueError(f"{name}: no place of {_TRIES} has the depths of '{kind}'")


def _fits(depth: np.ndarray, k: _Kind) -> bool:
    if np.isfinite(depth).mean() < 0.6:
        return False
    near, median, far = np.nanpercentile(depth, [2.0, 50.0, 95.0])
    least, (low, high), most = k.depths_m
    return bool(near > least and low < median < high and far < most)


def _case(name: str, here, there, camera: SimulatedCamera) -> Case:
    T_left_right = transforms.invert(here.T_world_cam) @ there.T_world_cam
    left = Picture("left", "camera", 0.0, here.rgb, camera.model, np.eye(4))
    right = Picture("right", "camera", 0.0, there.rgb, camera.model, T_left_right)
    configuration = replace(Configuration.between(np.eye(4), T_left_right), name=name)
    given = MapInput(InputKind.PHOTOGRAPHS, [ConfigurationInput(configuration, [left], [right])])
    return Case(name, given, here.depth, given)


def _with_errors(given: MapInput, prior: PosePrior, name: str) -> MapInput:
    """With the other pose off by what the prior says; the same draw for every prior."""
    random = np.random.default_rng(list(name.encode()))
    (c,) = given.configurations
    (other,) = c.others
    position_m = random.normal(size=3) * prior.position_sigma_m(c.configuration.baseline_m)
    error = transforms.from_xyz_rpy(position_m, random.normal(size=3) * prior.rotation_rad)
    moved = replace(other, T_home_cam=other.T_home_cam @ error)
    return replace(given, configurations=[replace(c, others=[moved])])
