# SPDX-License-Identifier: Apache-2.0
"""A small flight over the boards, what can be wrong with one of its pictures, and how a map is held
to its sigma."""

from dataclasses import replace
from typing import Sequence

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput, Picture
from support import boards

CAMERA = PinholeCamera.from_fov(320, 240, np.radians(56.0))
BASELINES_M = (2.0, 4.0, 8.0)
TOWN = boards.town()
# share of the depth: sigma below the one is a claim, an error above the other refutes it
CONFIDENT, WRONG = 0.03, 0.1
MOST_WRONG = 0.05  # "at most a few per cent" of the claims


def shot(name, T_home_cam, scene=TOWN, vehicle="uav2") -> Picture:
    return Picture(name, vehicle, 0.0, boards.draw(T_home_cam, scene, CAMERA), CAMERA, T_home_cam)


def flight(seed=1, scene=TOWN, of_other=None):
    """The reference, the true other pictures at 2, 4, 8 m, and the same with priors as a flight
    gives them.

    ``of_other`` (index to scene) shows some of the others another scene.
    """
    random = np.random.default_rng(seed)
    reference = shot("reference", boards.pose([0, 0, 0], (0.5, -0.4, 0.7)), scene, "uav1")
    poses = [boards.pose([0.03, -b, 0.02], random.normal(0, 1, 3)) for b in BASELINES_M]
    scenes = [(of_other or {}).get(i, scene) for i in range(len(poses))]
    true = [shot(f"uav2 at {b:g} m", T, s) for b, T, s in zip(BASELINES_M, poses, scenes)]
    return reference, true, [boards.noisy(t, reference, random) for t in true]


def session(scenes, seed=1) -> MapInput:
    """A flight as a session holds it: a reference picture of every configuration; ``scenes`` as
    each one met it.

    The reference vehicle hovers: 3 cm and 1 degree about its place, known to 0.05 degrees from one
    to the next.
    """
    random = np.random.default_rng(seed)
    configurations, first = [], None
    for i, (b, scene) in enumerate(zip(BASELINES_M, scenes)):
        true = shot(
            f"uav1/{i}",
            boards.pose(random.normal(0, 0.03, 3), random.normal(0, 1, 3)),
            scene,
            "uav1",
        )
        first = first or true
        other = shot(f"uav2/{i}", boards.pose([0.03, -b, 0.02], random.normal(0, 1, 3)), scene)
        reference = boards.noisy(true, first, random, 0.05) if i else true
        pictures = (
            replace(p, stamp_s=30.0 * i) for p in (reference, boards.noisy(other, first, random))
        )
        name = Configuration("horizontal", b, 0.0, f"horizontal {b:g} m")
        configurations.append(ConfigurationInput(name, *([p] for p in pictures)))
    return MapInput("session", configurations)


def given(reference: Picture, others: Sequence[Picture]) -> MapInput:
    configurations = [
        ConfigurationInput(
            Configuration("horizontal", b, 0.0, f"horizontal {b:g} m"), [reference], [o]
        )
        for o in others
        for b in [
            max(
                round(float(np.linalg.norm(o.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]))), 0.0
            )
        ]
    ]
    return MapInput("session", configurations)


def replaced(others: Sequence[Picture], index: int, fault) -> list:
    return [fault(p) if i == index else p for i, p in enumerate(others)]


def on_image(change):
    """A fault that changes a picture's values."""
    return lambda p: replace(
        p, image=np.clip(change(p.image.astype(float)), 0, 255).astype(np.uint8)
    )


blurred = on_image(lambda i: cv2.GaussianBlur(i, (0, 0), 6.0))
over_exposed = on_image(lambda i: i * 6.0)  # by 4 it is still placed, to 0.08 degrees, and used
under_exposed = on_image(lambda i: i / 16.0)
flat = on_image(lambda i: i * 0.0 + 128.0)


def elsewhere(picture: Picture) -> Picture:
    """It looks another way, at another scene; the prior says what it should have seen."""
    scene = [boards.Board((250.0, 0.0, -40.0), (190.0, 60.0), 901), *boards.town(7)[1:]]
    return replace(picture, image=boards.draw(picture.T_home_cam, scene, CAMERA))


def of_sky(picture: Picture) -> Picture:
    """Clouds, so far that they do not move."""
    return replace(
        picture,
        image=boards.draw(picture.T_home_cam, [boards.Board((1e5, 0, 0), (1e5, 1e5), 3)], CAMERA),
    )


def claims(result, truth: np.ndarray, within=True):
    """Share of all pixels that the map is sure of, and the share of these that is wrong (sky has no
    depth)."""
    sure = np.isfinite(result.depth) & (result.sigma < CONFIDENT * result.depth) & within
    wrong = sure & ~(np.abs(result.depth / truth - 1.0) <= WRONG)
    return float(sure.mean()), float(wrong.sum() / max(sure.sum(), 1))
