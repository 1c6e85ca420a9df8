# SPDX-License-Identifier: Apache-2.0
"""A vehicle's trajectory from the odometry of a session, without single wrong poses."""

from typing import List, Tuple

import numpy as np

from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo.sessions.left_out import LeftOut
from fcsv_stereo.sessions.stamped import Stamped

#: Silence of poses that is bridged (least and most, s): some lost ones, at the rate at which they
#: come. A tracker on the ground gives 8 to 10 a second; over 0.4 s a straight line is 1 to 2 cm off
#: where the vehicle brakes by 1 m/s2.
_GAP_S, _GAP_POSES = (0.1, 0.4), 4.0
#: A pose so far from both its neighbours, which agree with each other, is no flight: m, and m/s
#: from one to the next; rad, and rad/s.
_ASIDE_M, _ASIDE_MPS = 1.0, 50.0
_ASIDE_RAD, _ASIDE_RADPS = 0.5, 50.0
_APART_S = 0.5  # neighbours further away in time tell nothing

Poses = List[Tuple[float, np.ndarray]]


def track_of(odometry: Stamped, left_out: LeftOut, warnings: List[str]) -> List[Trajectory]:
    """One, or none where no pose is left: then ``left_out`` says why."""
    poses = odometry.in_order(np.array_equal, left_out, warnings)
    aside = _aside(poses)
    for i in aside:
        left_out.add(odometry.topic, poses[i][0], "its pose is far from those before and after it")
    track = Trajectory()
    for i, (stamp_s, T_odom_body) in enumerate(poses):
        if i not in aside:
            track.add(stamp_s, T_odom_body)
    return (
        [track.bridging(float(np.clip(_GAP_POSES * track.spacing_s, *_GAP_S)))]
        if len(track)
        else []
    )


def _aside(poses: Poses) -> set:
    """Indices of single poses that jump away and back."""
    if len(poses) < 3:
        return set()
    stamps = np.array([s for s, _ in poses])
    T = np.array([T for _, T in poses])
    near_s = np.diff(stamps)
    steps = (
        (np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1), _span_m(T), _ASIDE_M, _ASIDE_MPS),
        (_turns(T[:-1], T[1:]), _turns(T[:-2], T[2:]), _ASIDE_RAD, _ASIDE_RADPS),
    )
    far = np.zeros(len(poses), bool)
    for step, span, least, rate in steps:
        jump = step > least + rate * near_s
        far[1:-1] |= (
            jump[:-1]
            & jump[1:]
            & (span < 0.5 * np.minimum(step[:-1], step[1:]))
            & (stamps[2:] - stamps[:-2] < _APART_S)
        )
        for end, neighbour, beyond in ((0, 0, 1), (-1, -1, -2)):  # at the ends: the next two agree
            far[end] |= bool(jump[neighbour] and not jump[beyond] and near_s[neighbour] < _APART_S)
    return set(np.flatnonzero(far).tolist())


def _span_m(T: np.ndarray) -> np.ndarray:
    """Gives the span from each pose's predecessor to its successor."""
    return np.linalg.norm(T[2:, :3, 3] - T[:-2, :3, 3], axis=1)


def _turns(T_a: np.ndarray, T_b: np.ndarray) -> np.ndarray:
    """Angles (N,) between rotations."""
    traces = np.einsum("nij,nij->n", T_a[:, :3, :3], T_b[:, :3, :3])
    return np.arccos(np.clip((traces - 1.0) / 2.0, -1.0, 1.0))
