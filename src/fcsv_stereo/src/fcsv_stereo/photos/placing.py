# SPDX-License-Identifier: Apache-2.0
"""A model's photographs brought to their places on the earth, and what is to be said of each."""

from dataclasses import dataclass, replace
from typing import Dict, List, NamedTuple, Optional, Sequence

import numpy as np

from fcsv_geometry.earth import east_north_up_m, from_centre_m
from fcsv_stereo.errors import InputError
from fcsv_stereo.photos.evidence import MODEL_SHARE
from fcsv_stereo.photos.gps import Gps, with_steps
from fcsv_stereo.photos.similarity import ContradictionError, Similarity, fit

_EXPLAINED = 6.0  # standard deviations within which another reading of a tag explains a wrong place
_NAMED = 5  # kinds of what is wrong, in a message
_AS_SAID = 2.0  # times as much as usual, up to which GPS and model agree as well as they say


class Photograph(NamedTuple):
    """``R_model_cam`` is of its upright picture; ``no_gps`` and ``no_angles`` say why there is
    none."""

    name: str
    camera: str
    p_model: np.ndarray
    R_model_cam: np.ndarray
    gps: Optional[Gps]
    R_enu_cam: Optional[np.ndarray]
    no_gps: str = ""
    no_angles: str = ""


@dataclass(frozen=True)
class PlacedPhotographs:
    """``remarks``: by photograph, what of it was not used and why."""

    similarity: Similarity
    origin: Gps
    remarks: Dict[str, str]


def place(photographs: Sequence[Photograph]) -> PlacedPhotographs:
    """East, north, up of the first photograph whose GPS agrees with the others'. Raises
    InputError."""
    photographs = _with_steps(photographs)
    if not any(p.gps for p in photographs):
        raise InputError("none of the photographs with a pose has a GPS position")
    origin = _middle([p.gps for p in photographs if p.gps])
    try:
        found = _fit(photographs, origin)
        origin = next(p.gps for p, wrong in zip(photographs, found.outliers) if p.gps and not wrong)
        found = _fit(photographs, origin)
    except ContradictionError as error:
        _require_not_exchanged(photographs)
        raise InputError(
            f"{error}{_contradicting(photographs, error.similarity, origin)}"
        ) from error
    return PlacedPhotographs(found, origin, _remarks(photographs, found, origin))


def _with_steps(photographs: Sequence[Photograph]) -> List[Photograph]:
    by_camera: Dict[str, List[int]] = {}
    for i, p in enumerate(photographs):
        if p.gps is not None:
            by_camera.setdefault(p.camera, []).append(i)
    found = list(photographs)
    for of in by_camera.values():
        for i, gps in zip(of, with_steps([found[i].gps for i in of])):
            found[i] = found[i]._replace(gps=gps)
    return found


def _middle(places: Sequence[Gps]) -> Gps:
    """The place that is nearest to most."""
    centres = np.array([from_centre_m(p) for p in places])
    return places[int(np.argmin(np.linalg.norm(centres - np.median(centres, axis=0), axis=1)))]


def _fit(photographs: Sequence[Photograph], origin: Gps) -> Similarity:
    places, sigmas = np.full((len(photographs), 3), np.nan), np.ones((len(photographs), 3))
    known = [i for i, p in enumerate(photographs) if p.gps is not None]
    places[known] = east_north_up_m([photographs[i].gps for i in known], origin)
    sigmas[known] = [
        [g.sigma_m, g.sigma_m, g.height_sigma_m] for g in (photographs[i].gps for i in known)
    ]
    steps = np.zeros_like(places)
    steps[known] = [
        [g.step_m, g.step_m, g.height_step_m] for g in (photographs[i].gps for i in known)
    ]
    p_model = np.array([p.p_model for p in photographs])
    R_model_cam = np.array([p.R_model_cam for p in photographs])
    return fit(p_model, places, sigmas, R_model_cam, [p.R_enu_cam for p in photographs], steps)


def _require_not_exchanged(photographs: Sequence[Photograph]) -> None:
    """Whether all would agree with latitude and longitude the other way round."""
    if any(p.gps and abs(p.gps.longitude_deg) > 90.0 for p in photographs):
        return
    exchanged = [p._replace(gps=p.gps and _exchanged(p.gps)) for p in photographs]
    try:
        found = _fit(exchanged, _middle([p.gps for p in exchanged if p.gps]))
    except InputError:
        return
    if found.gps_factor > _AS_SAID or found.model_sigma_m > _AS_SAID * MODEL_SHARE * found.extent_m:
        return
    raise InputError(
        "latitude and longitude are exchanged in all photographs' GPS: the other way round they would agree"
    )


def _exchanged(gps: Gps) -> Gps:
    return replace(gps, latitude_deg=gps.longitude_deg, longitude_deg=gps.latitude_deg)


def _contradicting(photographs: Sequence[Photograph], found: Similarity, origin: Gps) -> str:
    """The end of the sentence: whose places are wrong, by what is wrong with them."""
    if not found.outliers.any():
        return ""
    names: Dict[str, List[str]] = {}
    for i in np.flatnonzero(found.outliers):
        names.setdefault(_why(photographs[i], i, found, origin), []).append(photographs[i].name)
    told = [f"{', '.join(of)} ({why})" for why, of in list(names.items())[:_NAMED]]
    more = sum(map(len, list(names.values())[_NAMED:]))
    and_more = f"; and {more} more" if more else ""
    return f": {'; '.join(told)}{and_more}. Correct the tags, or take the wrong ones away"


def _remarks(photographs: Sequence[Photograph], found: Similarity, origin: Gps) -> Dict[str, str]:
    remarks = {}
    for i, p in enumerate(photographs):
        said = []
        if p.gps is None:
            said.append(f"its place is not used: {p.no_gps}")
        elif found.outliers[i]:
            what = "height" if found.wrong_heights[i] else "place"
            said.append(f"its {what} is not used: {_why(p, i, found, origin)}")
        if found.wrong_angles[i]:
            said.append("its gimbal angles are not used: they contradict the others")
        elif p.R_enu_cam is None and p.no_angles:
            said.append(p.no_angles)
        if said:
            remarks[p.name] = "; ".join(said)
    return remarks


def _why(p: Photograph, i: int, found: Similarity, origin: Gps) -> str:
    """The reading of its tags with which it would agree, or how far it is off."""
    expected_m = found.scale * found.R_enu_model @ p.p_model + found.t_enu
    bound_m = _EXPLAINED * (
        found.model_sigma_m + max(1.0, found.gps_factor) * p.gps.height_sigma_m + p.gps.step_m
    )
    for other, why in _readings(p.gps):
        if np.linalg.norm(east_north_up_m([other], origin)[0] - expected_m) < bound_m:
            return why
    east, north, up = found.residuals_m[i]
    if found.wrong_heights[i]:
        return f"its height is {abs(up):.0f} m {'above' if up > 0 else 'below'} where the others have it"
    away = np.hypot(np.hypot(east, north), up)
    return (
        f"{away:.3g} m from where the others have it"
        if away < 1000
        else f"{away / 1000:.0f} km from the others"
    )


def _readings(gps: Gps):
    """The place with tags that are wrong as tags are wrong."""
    latitude, longitude = gps.latitude_deg, gps.longitude_deg
    east, north = (
        ("W", "E") if longitude < 0 else ("E", "W"),
        ("S", "N") if latitude < 0 else ("N", "S"),
    )
    up = ("below", "above") if gps.height_m < 0 else ("above", "below")
    yield (
        replace(gps, longitude_deg=-longitude),
        f"GPSLongitudeRef {east[1]} instead of {east[0]} would agree",
    )
    yield (
        replace(gps, latitude_deg=-latitude),
        f"GPSLatitudeRef {north[1]} instead of {north[0]} would agree",
    )
    yield (
        replace(gps, height_m=-gps.height_m),
        f"GPSAltitudeRef '{up[1]}' instead of '{up[0]}' would make its height agree",
    )
    if abs(longitude) <= 90.0:
        yield _exchanged(gps), "latitude and longitude exchanged would agree"
