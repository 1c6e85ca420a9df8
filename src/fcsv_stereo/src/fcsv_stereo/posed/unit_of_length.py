# SPDX-License-Identifier: Apache-2.0
"""Photographs in a unit of length of their own: their map is the same whatever unit their poses
come in.

Sessions are in metres, and stay so.
"""

from dataclasses import replace

import numpy as np

from fcsv_stereo.model import (
    Cloud,
    ConfigurationInput,
    ImageEntry,
    InputKind,
    MapInput,
    MapResult,
    Picture,
)

# numbers of ``joint.tuning`` that are lengths were chosen at about such baselines
_MEDIAN_BASELINE_M = 4.0
_POSITION = np.repeat([1.0, 0.0], 3)  # of a pose's covariance in home, position first


def unit_of(given: MapInput) -> float:
    """Length (m) of the unit in which the cameras' median distance from the reference is 4 m;
    1 for sessions, and where there is no such distance."""
    if given.kind is InputKind.SESSION:
        return 1.0
    median_m = float(np.median([c.configuration.baseline_m for c in given.configurations] or [0.0]))
    return median_m / _MEDIAN_BASELINE_M if median_m > 0.0 else 1.0


def in_unit(given: MapInput, unit_m: float) -> MapInput:
    """The same input with lengths in units of ``unit_m``."""
    if unit_m == 1.0:
        return given
    shrunk = {
        id(p): _picture(p, unit_m) for c in given.configurations for p in (*c.references, *c.others)
    }

    def configuration(c: ConfigurationInput) -> ConfigurationInput:
        baseline_m = c.configuration.baseline_m / unit_m
        references, others = (
            [shrunk[id(p)] for p in pictures] for pictures in (c.references, c.others)
        )
        return replace(
            c,
            configuration=replace(c.configuration, baseline_m=baseline_m),
            references=references,
            others=others,
        )

    prior = None if given.prior is None else given.prior.in_unit(unit_m)
    return replace(
        given, configurations=[configuration(c) for c in given.configurations], prior=prior
    )


def in_metres(result: MapResult, unit_m: float) -> MapResult:
    """The map of an input that was in units of ``unit_m``, in metres."""
    if unit_m == 1.0:
        return result
    unit = np.float32(unit_m)
    cloud = result.cloud
    cloud = Cloud(
        cloud.points_home_m * unit, cloud.colors, cloud.sigma_m * unit, cloud.baseline_index
    )
    reference = replace(result.reference, T_home_cam=_moved(result.reference.T_home_cam, unit_m))
    images = [_entry(i, unit_m) for i in result.images]
    depth, sigma = result.depth * unit, result.sigma * unit
    pairs = [p.in_metres(unit_m, lambda q: _picture(q, 1.0 / unit_m), depth) for p in result.pairs]
    return replace(
        result,
        reference=reference,
        images=images,
        pairs=pairs,
        depth=depth,
        sigma=sigma,
        cloud=cloud,
    )


def _picture(picture: Picture, unit_m: float) -> Picture:
    covariance = picture.covariance
    if covariance is not None:
        scale = np.where(_POSITION > 0.0, 1.0 / unit_m, 1.0)
        covariance = covariance * np.outer(scale, scale)
    return replace(
        picture, T_home_cam=_moved(picture.T_home_cam, 1.0 / unit_m), covariance=covariance
    )


def _entry(image: ImageEntry, unit_m: float) -> ImageEntry:
    poses = [_moved(T, unit_m) for T in (image.T_home_cam, image.prior_T_home_cam)]
    return replace(image, T_home_cam=poses[0], prior_T_home_cam=poses[1])


def _moved(T_home_cam: np.ndarray, times: float) -> np.ndarray:
    out = T_home_cam.copy()
    out[:3, 3] *= times
    return out
