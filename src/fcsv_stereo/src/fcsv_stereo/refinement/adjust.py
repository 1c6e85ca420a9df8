# SPDX-License-Identifier: Apache-2.0
"""One robust adjustment of all pictures' poses with their priors (GTSAM), points eliminated."""

from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional, Tuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import F, T, X

from fcsv_geometry import rotations
from fcsv_stereo.refinement.geometry import PairPrior
from fcsv_stereo.refinement.structure import Observations, Structure
from fcsv_stereo.refinement.time_offset import Motion

# standard deviations from which a prior pulls no harder: one of them may be wrong
_PRIOR_KERNEL = 4.0
# the normal matrix has entries of 1e7; with less the step would not become short
_MOST_DAMPING = 1e12


@dataclass(frozen=True)
class Problem:
    """Pictures by number, 0 the reference: priors of T_ref_cam, focal lengths and measuring noise
    (px).

    ``focal_sigma`` is the prior's share for a common scale of the focal lengths, 0 where it is
    held. ``shared`` are (6, 6) cross covariances of two pictures' priors, rotation first, in their
    camera axes.
    """

    observations: Observations
    priors: Dict[int, PairPrior]
    focals_px: Dict[int, float]
    noise_px: Dict[int, float]
    focal_sigma: float = 0.0
    moving: List[Motion] = field(default_factory=list)
    time_offset_sigma_s: float = 0.1
    shared: Dict[Tuple[int, int], np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class AdjustedPoses:
    """Poses T_ref_cam; ``covariance`` of them in order (rotation, position, in camera axes);
    residuals (M, 2) px."""

    poses: Dict[int, np.ndarray]
    order: List[int]
    covariance: np.ndarray
    rho: np.ndarray
    focal_scale: float
    time_offsets_s: List[float]  # in the order of the problem's moving vehicles
    residual_px: np.ndarray
    focal_sigma: float = 0.0  # standard deviation of ``focal_scale``, 0 where it was held
    # as ``covariance``, beside it: of errors that all points share
    systematic: Optional[np.ndarray] = None
    focal: Optional[np.ndarray] = None  # the same of a focal length that may be wrong
    focal_probability: float = 0.0  # that it is wrong
    # (6n,) how the poses follow ``focal_scale``, None where it was held
    by_focal: Optional[np.ndarray] = None


def adjust(problem: Problem, starts: Dict[int, np.ndarray], rho: np.ndarray) -> AdjustedPoses:
    """Levenberg-Marquardt from poses ``starts`` and inverse depths ``rho`` (N,) 1/m."""
    order = sorted(problem.priors)
    structure = Structure(problem.observations, rho, problem.focals_px, problem.noise_px)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k in order:
        graph.add(_prior_factor(problem, k))
        values.insert(X(k), gtsam.Pose3(starts[k]))
    for i, _ in enumerate(problem.moving):
        sigma = gtsam.noiseModel.Isotropic.Sigma(1, problem.time_offset_sigma_s)
        graph.add(gtsam.PriorFactorVector(T(i), np.zeros(1), sigma))
        values.insert(T(i), np.zeros(1))
    with_focal = problem.focal_sigma > 0.0
    if with_focal:
        sigma = gtsam.noiseModel.Isotropic.Sigma(1, problem.focal_sigma)
        graph.add(gtsam.PriorFactorVector(F(0), np.ones(1), sigma))
        values.insert(F(0), np.ones(1))
    graph.add(_structure_factor(structure, order, with_focal))
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(25)
    params.setRelativeErrorTol(1e-5)
    params.setlambdaUpperBound(_MOST_DAMPING)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    poses, scale = _poses(result, order), _scale(result, with_focal)
    structure.settle(poses, scale)
    residual = structure.linearise(poses, scale, poses_too=False).residual
    offsets = [float(result.atVector(T(i))[0]) for i in range(len(problem.moving))]
    n = 6 * len(order)
    covariance = _covariance(graph, result, [X(k) for k in order] + ([F(0)] if with_focal else []))
    focal_sigma = float(np.sqrt(covariance[n, n])) if with_focal else 0.0
    by_focal = covariance[:n, n] / covariance[n, n] if with_focal else None
    covariance = _with_shared(covariance[:n, :n], problem, order)
    found = AdjustedPoses(
        poses, order, covariance, structure.rho, scale, offsets, residual, focal_sigma
    )
    return replace(found, by_focal=by_focal)


def _prior_factor(problem: Problem, k: int):
    prior = problem.priors[k]
    if prior.covariance is not None:
        sigmas = gtsam.noiseModel.Gaussian.Covariance(prior.covariance)
    else:
        sigmas = gtsam.noiseModel.Diagonal.Sigmas(
            np.repeat([prior.rotation_rad, prior.position_m], 3)
        )
    sigmas = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Huber.Create(_PRIOR_KERNEL), sigmas
    )
    for i, motion in enumerate(problem.moving):
        if k in motion.pictures:
            return _moving_prior(k, i, prior, motion.pictures[k], sigmas)
    return gtsam.PriorFactorPose3(X(k), gtsam.Pose3(prior.T_a_b), sigmas)


def _moving_prior(k: int, i: int, prior: PairPrior, velocity_mps: np.ndarray, sigmas):
    """The prior, moved along the track by the vehicle's time offset: position + velocity x
    offset."""
    R_prior, p_prior = prior.T_a_b[:3, :3], prior.T_a_b[:3, 3]

    def evaluate(_, values, jacobians):
        pose = values.atPose3(X(k))
        R = R_prior.T @ pose.rotation().matrix()
        away = pose.translation() - p_prior - velocity_mps * values.atVector(T(i))[0]
        rotation = gtsam.Rot3.Logmap(gtsam.Rot3(R))
        if jacobians is not None:
            J = np.zeros((6, 6), order="F")
            J[:3, :3] = rotations.inverse_right_jacobian(rotation)
            J[3:, 3:] = R
            jacobians[0] = J
            jacobians[1] = np.asfortranarray(
                np.concatenate([np.zeros(3), -R_prior.T @ velocity_mps])[:, None]
            )
        return np.concatenate([rotation, R_prior.T @ away])

    return gtsam.CustomFactor(sigmas, gtsam.KeyVector([X(k), T(i)]), evaluate)


def _structure_factor(
    structure: Structure, order: List[int], with_focal: bool
) -> gtsam.CustomFactor:
    """Everything that the pictures say about the poses, as one factor.

    Its residual e has derivative A with A'A the reduced normal matrix and A'e the gradient; a last
    row makes |e|^2 the robust cost, which is what the optimiser compares.
    """
    keys = [X(k) for k in order] + ([F(0)] if with_focal else [])
    size = 6 * len(order) + int(with_focal)
    # the optimiser asks for the error first and, where it likes it, for the derivative at the same
    # place
    last = {}

    def reduced(poses, scale):
        place = (scale, *(poses[k].tobytes() for k in order))
        if place not in last:
            last.clear()
            last[place] = structure.reduced(poses, scale, order, with_focal)
        return last[place]

    def evaluate(_, values, jacobians):
        H, g, cost = reduced(_poses(values, order), _scale(values, with_focal))
        # rounding may leave what is not known a little below zero
        value, vector = np.linalg.eigh(H)
        value = np.sqrt(np.maximum(value, 1e-12 * value[-1] + 1e-9))
        root, error = value[:, None] * vector.T, vector.T @ g / value
        if jacobians is not None:
            A = np.vstack([root, np.zeros(size)])
            for i in range(len(order)):
                jacobians[i] = np.asfortranarray(A[:, 6 * i : 6 * i + 6])
            if with_focal:
                jacobians[-1] = np.asfortranarray(A[:, -1:])
        return np.append(error, np.sqrt(max(cost - error @ error, 0.0)))

    return gtsam.CustomFactor(
        gtsam.noiseModel.Unit.Create(size + 1), gtsam.KeyVector(keys), evaluate
    )


def _poses(values, order) -> Dict[int, np.ndarray]:
    return {0: np.eye(4), **{k: values.atPose3(X(k)).matrix() for k in order}}


def _scale(values, with_focal) -> float:
    return float(values.atVector(F(0))[0]) if with_focal else 1.0


def _covariance(graph, result, keys: List[int]) -> np.ndarray:
    """Gives the covariance of all variables, these first and in this order, by inverting GTSAM's
    normal matrix: its Marginals call these scales singular."""
    linear = graph.linearize(result)
    ordering = gtsam.Ordering()
    for key in keys + [k for k in result.keys() if k not in keys]:
        ordering.push_back(key)
    information, _ = linear.hessian(ordering)
    scale = 1.0 / np.sqrt(np.diag(information))
    return np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)


def _with_shared(covariance: np.ndarray, problem: Problem, order: List[int]) -> np.ndarray:
    """The covariance of the same poses where the priors' errors are not independent, as the
    adjustment takes them.

    The poses follow the priors' errors e by P L e (P: covariance, L: priors' information), so P,
    which takes L^-1 for the covariance S of e, grows by P L (S - L^-1) L P. Without it one
    vehicle's scale, which is in all its pictures, would seem to average out.
    """
    if not problem.shared:
        return covariance
    place = {k: slice(6 * i, 6 * i + 6) for i, k in enumerate(order)}
    own, shared = np.zeros_like(covariance), np.zeros_like(covariance)
    for k in order:
        if problem.priors[k].covariance is not None:
            own[place[k], place[k]] = problem.priors[k].covariance
    for (a, b), cross in problem.shared.items():
        shared[place[a], place[b]], shared[place[b], place[a]] = cross, cross.T
    # what is taken to be carried along can be too much
    value, vector = np.linalg.eigh(own + shared)
    together = (vector * np.maximum(value, 0.0)) @ vector.T
    gain = covariance @ np.linalg.pinv(own)
    return covariance + gain @ (together - own) @ gain.T
