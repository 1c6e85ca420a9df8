# SPDX-License-Identifier: Apache-2.0
"""What became of a picture: its refined pose, or its prior and the reason."""

from dataclasses import replace
from typing import Dict, List, Optional, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Picture, PoseUncertainty
from fcsv_stereo.pose_covariance import of_scale, prior_covariance
from fcsv_stereo.refinement.adjust import AdjustedPoses
from fcsv_stereo.refinement.consensus import Consensus
from fcsv_stereo.refinement.features import FeatureView
from fcsv_stereo.refinement.geometry import epipolar_error
from fcsv_stereo.refinement.graph import distance_m, prior_to_reference
from fcsv_stereo.refinement.links import PairLink
from fcsv_stereo.refinement.types import RefinedPicture, RefineOptions

_LEAST_GAIN = 0.7  # the rotation's standard deviation must shrink below this share of the prior's
# of the baseline: a camera that far from its prior was not where its configuration says
_FARTHEST_SHARE = 0.25
_ALL = 3  # pictures whose poses are contradicted at once: fewer may be so by chance
_WRONG_FOCAL = 0.5  # probability
_NOISY = 1.5  # times the median noise of the pictures
# standard deviations of an axis: a correction in three axes is longer once in a thousand times
_SURPRISE = 4.0


def decide(
    views: List[FeatureView], k: int, direct: PairLink, consensus: Consensus, options: RefineOptions
) -> RefinedPicture:
    """Picture k as the consensus left it. Covariance of a refused one is its prior's."""
    prior_T = views[k].picture.T_home_cam
    adjusted = consensus.adjusted
    reason = consensus.refused.get(k, "")
    if not reason and (adjusted is None or k not in adjusted.order):
        reason = direct.reason or "no picture that it overlaps with could be refined"
    compared, pixel = 0, None
    if not reason:
        known = _uncertainty(views[0], adjusted, k, options)
        T_home_cam = views[0].picture.T_home_cam @ adjusted.poses[k]
        if _no_gain(views, k, known, options):
            sigma_deg = np.degrees(np.sqrt(np.diag(known.noise + known.shared)[:3]).max())
            reason = f"the pictures fix its rotation no better than {sigma_deg:.2g} degrees"
            compared, pixel = _epipolar(views, k, consensus)[2], known.shared
        else:
            reason = _doubt(views, k, T_home_cam, options)
    if reason:
        arm_m = prior_T[:3, 3] - views[0].picture.T_home_cam[:3, 3]
        scale = of_scale(arm_m, options.prior.scale_sigma)
        known = PoseUncertainty(_prior(views, k, options), scale, pixel=pixel)
        if _focal_is_wrong(adjusted, k):
            known = _with_focal(known, views[0], adjusted, k)
        picture, nan = _with_common_focal(views[k].picture, adjusted), float("nan")
        return RefinedPicture(picture, prior_T, False, reason, compared, nan, nan, known)
    before, after, inliers = _epipolar(views, k, consensus)
    picture = replace(_with_common_focal(views[k].picture, adjusted), T_home_cam=T_home_cam)
    known = known if adjusted.focal is None else _with_focal(known, views[0], adjusted, k)
    return RefinedPicture(picture, prior_T, True, "", inliers, before, after, known)


def _with_common_focal(picture: Picture, adjusted: Optional[AdjustedPoses]) -> Picture:
    """Gives the picture with the focal length that was adjusted for all, also of a picture that had
    no part in it."""
    scale = 1.0 if adjusted is None else adjusted.focal_scale
    return picture if scale == 1.0 else replace(picture, camera=scaled(picture.camera, scale))


def _focal_is_wrong(adjusted: Optional[AdjustedPoses], k: int) -> bool:
    """Whether the pictures speak against the focal length: depths are wrong by it, whatever pose is
    taken."""
    return (
        adjusted is not None and k in adjusted.order and adjusted.focal_probability > _WRONG_FOCAL
    )


def _with_focal(
    known: PoseUncertainty, reference: FeatureView, adjusted: AdjustedPoses, k: int
) -> PoseUncertainty:
    focal = _own(reference, adjusted, k, adjusted.focal)
    return replace(known, focal=focal, focal_probability=adjusted.focal_probability)


def scaled(camera: PinholeCamera, focal_scale: float) -> PinholeCamera:
    """The camera with its focal lengths multiplied."""
    return (
        replace(camera, fx=camera.fx * focal_scale, fy=camera.fy * focal_scale)
        if focal_scale != 1.0
        else camera
    )


def _no_gain(
    views: List[FeatureView], k: int, known: PoseUncertainty, options: RefineOptions
) -> bool:
    """Whether the prior's rotation is as good as what the pictures tell, by their noise or by all
    their errors."""
    noise_rad, all_rad = (
        float(np.sqrt(np.diag(c)[:3]).max()) for c in (known.noise, known.noise + known.shared)
    )
    prior_rad = prior_to_reference(views, k, options.prior).rotation_rad
    return noise_rad > _LEAST_GAIN * prior_rad or all_rad > prior_rad


def _doubt(views: List[FeatureView], k: int, T_home_cam, options: RefineOptions) -> str:
    away_m = float(np.linalg.norm(T_home_cam[:3, 3] - views[k].picture.T_home_cam[:3, 3]))
    allowed_m = _FARTHEST_SHARE * distance_m(views, k)
    if away_m > allowed_m and away_m > _position_surprise_m(views, k, options):
        put_m, baseline_m = away_m * options.unit_m, distance_m(views, k) * options.unit_m
        return f"the pictures put it {put_m:.3g} m from its prior, with a baseline of {baseline_m:.3g} m"
    return ""


def surprise(
    views: List[FeatureView], k: int, refined: RefinedPicture, options: RefineOptions
) -> str:
    """Says, in words, where a refined pose says that the prior was wrong; empty where it was
    not."""
    words = []
    if (
        refined.correction_rad
        > _SURPRISE * prior_to_reference(views, k, options.prior).rotation_rad
    ):
        words.append(f"rotation by {np.degrees(refined.correction_rad):.1f} degrees")
    if refined.correction_m > _position_surprise_m(views, k, options):
        words.append(f"position by {refined.correction_m * options.unit_m:.3g} m")
    return (
        f"its prior was wrong in {' and '.join(words)}; the pictures' own pose was taken"
        if words
        else ""
    )


def all_wrong(
    views: List[FeatureView], refined: List[RefinedPicture], options: RefineOptions
) -> str:
    """Says, in words, where the pictures contradict all poses at once; empty where they do not."""
    if len(refined) < _ALL or not all(
        r.refined and surprise(views, k, r, options) for k, r in enumerate(refined, 1)
    ):
        return ""
    turned_deg = np.degrees(max(r.correction_rad for r in refined))
    moved_m = max(r.correction_m for r in refined) * options.unit_m
    return (
        f"the pictures contradict the poses of all {len(refined)} others at once (rotation by up to {turned_deg:.1f} "
        f"degrees, position by up to {moved_m:.3g} m): either poses are worse than stated, or the camera is not the "
        "stated one (focal length, principal point, distortion); the pictures' own poses were taken: check the "
        "calibration, or state larger errors of the poses"
    )


def contradicted(views: List[FeatureView], consensus: Consensus, options: RefineOptions) -> bool:
    """Whether the poses of all pictures end far from their priors, of three or more."""
    adjusted = consensus.adjusted
    if adjusted is None or len(adjusted.order) < _ALL:
        return False
    return all(_away(views, k, adjusted.poses[k], options) > _SURPRISE for k in adjusted.order)


def unclear(
    views: List[FeatureView],
    consensus: Consensus,
    direct: Dict[int, PairLink],
    options: RefineOptions,
) -> bool:
    """Whether some picture was left out, ends far from its prior, or fits worse than the others."""
    adjusted = consensus.adjusted
    if adjusted is None or any(k not in adjusted.order for k in direct):
        return True
    noise_px = consensus.problem.noise_px
    usual_px = float(np.median([noise_px[k] for k in adjusted.order]))
    return any(
        _away(views, k, adjusted.poses[k], options) > _SURPRISE or noise_px[k] > _NOISY * usual_px
        for k in adjusted.order
    )


def _away(views: List[FeatureView], k: int, T_ref_cam: np.ndarray, options: RefineOptions) -> float:
    """How far a pose ends from its prior, in the prior's standard deviations."""
    prior = prior_to_reference(views, k, options.prior)
    off = transforms.invert(prior.T_a_b) @ T_ref_cam
    turned_rad = float(Rotation.from_matrix(off[:3, :3]).magnitude())
    return max(
        turned_rad / prior.rotation_rad, float(np.linalg.norm(off[:3, 3])) / prior.position_m
    )


def _position_surprise_m(views: List[FeatureView], k: int, options: RefineOptions) -> float:
    return _SURPRISE * prior_to_reference(views, k, options.prior).position_m


def _uncertainty(
    reference: FeatureView, adjusted: AdjustedPoses, k: int, options: RefineOptions
) -> PoseUncertainty:
    """Gives the uncertainty of picture k's pose as it was adjusted, without that of its focal
    length."""
    arm_m = reference.picture.T_home_cam[:3, :3] @ adjusted.poses[k][:3, 3]
    shared = of_scale(arm_m, options.prior.scale_sigma)
    if adjusted.systematic is not None:
        shared = shared + _own(reference, adjusted, k, adjusted.systematic)
    return PoseUncertainty(_own(reference, adjusted, k, adjusted.covariance), shared)


def _own(reference: FeatureView, adjusted, k: int, covariance: np.ndarray) -> np.ndarray:
    """Picture k's part (6x6) of a ``covariance`` of all poses, its position turned to home axes."""
    own = slice(6 * adjusted.order.index(k), 6 * adjusted.order.index(k) + 6)
    turn = np.eye(6)
    turn[3:, 3:] = reference.picture.T_home_cam[:3, :3] @ adjusted.poses[k][:3, :3]
    return turn @ covariance[own, own] @ turn.T


def _prior(views: List[FeatureView], k: int, options: RefineOptions) -> np.ndarray:
    return prior_covariance(views[0].picture, views[k].picture, options.prior)


def _epipolar(views: List[FeatureView], k: int, consensus: Consensus) -> Tuple[float, float, int]:
    """rms (px) before and after over the inliers of all pairs that end in picture k, and their
    number."""
    o, scale = consensus.observations, consensus.adjusted.focal_scale
    anchors = o.anchor[o.point]
    undo = np.array([1.0 / scale, 1.0 / scale, 1.0])
    before, after = [], []
    for a, b in sorted(set(zip(anchors.tolist(), o.picture.tolist()))):
        if k in (a, b):
            of = (anchors == a) & (o.picture == b)
            rays_a, rays_b = o.anchor_rays[o.point[of]], o.rays[of]
            prior = transforms.invert(views[a].picture.T_home_cam) @ views[b].picture.T_home_cam
            poses = consensus.adjusted.poses
            refined = transforms.invert(poses[a]) @ poses[b]
            before.append(epipolar_error(prior, rays_a, rays_b)[0] * views[b].picture.camera.fx)
            after.append(
                epipolar_error(refined, rays_a * undo, rays_b * undo)[0]
                * views[b].picture.camera.fx
                * scale
            )
    rms = [float(np.sqrt(np.mean(np.concatenate(e) ** 2))) for e in (before, after)]
    return rms[0], rms[1], sum(map(len, after))
