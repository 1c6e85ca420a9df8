# SPDX-License-Identifier: Apache-2.0
"""The time offset between a camera and its tracker, from the turns that both saw.

A stamp that is wrong by dt moves the prior of a moving camera by v dt: 7 mm at 1.5 m/s and 5 ms,
which an unknown centimetre of the calibration hides. But the camera also turns, by its vehicle's
leaning and its vibration, and turns between one picture and the next are seen to a hundredth of a
degree: the offset is that at which the tracker's turns agree with them (the principle of camera-IMU
calibration). Neither calibration nor drift takes part.
"""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline

from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo.model import Picture, as_grey

_MOST_S = 0.04  # larger ones are of clocks that were never synchronised
_COARSE_S, _FINE_S = 0.001, 0.0001
_LONGEST_GAP_S = 0.5  # between two pictures: corners must be found again
_MOST_TURNS = 60
_LEAST_TURNS = 8
_CORNERS, _LEAST_CORNERS = 250, 30
_CORNER_PX = 0.3
_BACK_PX = 0.5  # a corner that is tracked there and back ends where it began
# 1/m: expected; standard deviations of all in common, of one
_INVERSE_DEPTH, _OF_SCENE, _OF_CORNER = 0.03, 0.05, 0.1
_TRACKER_RAD = np.radians(0.03)  # of a turn by the tracker
_MOST_SPACING_S = 0.02  # of the tracker's poses: rarer ones do not show what vibrates
_ROBUST = 2.5  # standard deviations
_SURE = 25.0  # by how much the cost elsewhere is higher
_APART_S = 0.006  # "elsewhere"
_ROUNDS = 4


@dataclass(frozen=True)
class StampOffset:
    """``offset_s`` is to be added to the stamps of the camera's pictures; ``known``: the pictures
    tell it beyond doubt. ``turns``: so many turns between pictures were compared."""

    offset_s: float
    sigma_s: float
    turns: int
    known: bool

    def to_dict(self) -> dict:
        """Gives the offset for report.json; ``offset_ms`` is null where it is not known."""
        offset_ms, sigma_ms = (
            (round(1e3 * s, 2) for s in (self.offset_s, self.sigma_s))
            if self.known
            else (None, None)
        )
        return {
            "offset_ms": offset_ms,
            "sigma_ms": sigma_ms,
            "turns": self.turns,
            "known": self.known,
        }

    @property
    def words(self) -> str:
        """Says the offset for a person.

        >>> StampOffset(0.005, 0.0002, 40, True).words
        '+5.0 ms ±0.2'
        """
        if not self.known:
            return "not seen"
        return f"{1e3 * self.offset_s:+.1f} ms ±{1e3 * self.sigma_s:.1f}"


@dataclass(frozen=True)
class CameraTurn:
    """Holds a turn from picture ``first`` to ``second`` (stamps, s), as seen: R_second_first, and
    its information (3, 3) about the second camera's axes."""

    first_s: float
    second_s: float
    R_second_first: np.ndarray
    information: np.ndarray


def clock_offset(
    pictures: Sequence[Picture], track: Trajectory, R_body_cam: np.ndarray
) -> Optional[StampOffset]:
    """Finds the offset of one vehicle: ``pictures`` in order of time, ``track`` of T_odom_body.
    None where too few turns are seen."""
    turns = seen_turns(pictures)
    return fitted(turns, track, R_body_cam) if len(turns) >= _LEAST_TURNS else None


def seen_turns(pictures: Sequence[Picture]) -> List[CameraTurn]:
    """Between neighbours in time, at most 60, spread over the recording."""
    pairs = [
        (a, b)
        for a, b in zip(pictures, pictures[1:])
        if 0.0 < b.stamp_s - a.stamp_s <= _LONGEST_GAP_S
    ]
    step = max(1, -(-len(pairs) // _MOST_TURNS))
    turns = (_turn(a, b) for a, b in pairs[::step])
    return [t for t in turns if t is not None]


def fitted(
    turns: Sequence[CameraTurn], track: Trajectory, R_body_cam: np.ndarray
) -> Optional[StampOffset]:
    """The offset at which the track's turns agree best. None where the track does not reach far
    enough."""
    known = _Track.of(turns, track, R_body_cam)
    if known is None:
        return None
    kept = [t for t in turns if known.holds(t)]
    if len(kept) < _LEAST_TURNS:
        return None
    grid_s = np.arange(-_MOST_S, _MOST_S + _COARSE_S / 2, _COARSE_S)
    costs = np.array([known.cost(kept, s) for s in grid_s])
    around_s = grid_s[costs.argmin()] + np.arange(-15, 16) * _FINE_S
    fine = np.array([known.cost(kept, s) for s in around_s])
    curve, _, _ = np.polyfit(around_s - around_s[fine.argmin()], fine, 2)
    spread = max(float(fine.min()) / (3.0 * len(kept)), 1.0)  # the noise was larger than thought
    sigma_s = float(np.sqrt(spread / curve)) if curve > 0.0 else float("inf")
    best_s = float(around_s[fine.argmin()])
    elsewhere = costs[np.abs(grid_s - best_s) > _APART_S]
    inside = abs(best_s) < _MOST_S - _APART_S
    known_ = (
        inside and sigma_s < _APART_S / 2 and float(elsewhere.min() - fine.min()) / spread > _SURE
    )
    return StampOffset(best_s, sigma_s, len(kept), known_)


@dataclass(frozen=True)
class _Track:
    """Rotations of the camera in its odometry frame, by time."""

    turned: RotationSpline
    first_s: float
    last_s: float

    @classmethod
    def of(
        cls, turns: Sequence[CameraTurn], track: Trajectory, R_body_cam: np.ndarray
    ) -> Optional["_Track"]:
        first_s, last_s = turns[0].first_s - _MOST_S, turns[-1].second_s + _MOST_S
        stamps_s, poses = track.within(first_s - _MOST_S, last_s + _MOST_S)
        if len(stamps_s) < 2 or float(np.median(np.diff(stamps_s))) > _MOST_SPACING_S:
            return None
        rotations = Rotation.from_matrix(poses[:, :3, :3] @ R_body_cam)
        return cls(RotationSpline(stamps_s, rotations), float(stamps_s[0]), float(stamps_s[-1]))

    def holds(self, turn: CameraTurn) -> bool:
        """Whether it reaches around a turn at every offset."""
        return self.first_s + _MOST_S < turn.first_s and turn.second_s < self.last_s - _MOST_S

    def cost(self, turns: Sequence[CameraTurn], offset_s: float) -> float:
        """Twice a robust log likelihood of what was seen, were this the offset."""
        first = self.turned(np.array([t.first_s for t in turns]) + offset_s)
        second = self.turned(np.array([t.second_s for t in turns]) + offset_s)
        seen = Rotation.from_matrix(np.array([t.R_second_first for t in turns]))
        w = (seen * (second.inv() * first).inv()).as_rotvec()
        squares = np.einsum("ni,nij,nj->n", w, np.array([t.information for t in turns]), w)
        far = squares > _ROBUST**2
        return float(np.where(far, 2.0 * _ROBUST * np.sqrt(squares) - _ROBUST**2, squares).sum())


# ---- what two pictures show ----------------------------------------------------------------------


def _turn(a: Picture, b: Picture) -> Optional[CameraTurn]:
    """The prior's movement is taken, and what turn is needed besides; along the parallax a corner
    says little."""
    R0 = b.T_home_cam[:3, :3].T @ a.T_home_cam[:3, :3]
    t0 = b.T_home_cam[:3, :3].T @ (a.T_home_cam[:3, 3] - b.T_home_cam[:3, 3])
    rays, seen = _tracked(a, b, R0)
    if len(rays) < _LEAST_CORNERS:
        return None
    found = _rotation(rays @ R0.T, seen, t0, _CORNER_PX / b.camera.fx)
    if found is None:
        return None
    w, covariance = found
    information = np.linalg.inv(covariance + _TRACKER_RAD**2 * np.eye(3))
    return CameraTurn(a.stamp_s, b.stamp_s, Rotation.from_rotvec(w).as_matrix() @ R0, information)


def _tracked(a: Picture, b: Picture, R0: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Rays (N, 3) with z = 1 of corners in ``a``, and where (N, 2) on the plane z = 1 they are in
    ``b``."""
    first, second = as_grey(a.image), as_grey(b.image)
    corners = cv2.goodFeaturesToTrack(first, _CORNERS, 0.01, 8)
    if corners is None:
        return np.empty((0, 3)), np.empty((0, 2))
    rays = _rays(a, corners[:, 0])
    guess = rays @ R0.T
    start = (
        guess[:, :2] / guess[:, 2:] * [b.camera.fx, b.camera.fy] + [b.camera.cx, b.camera.cy]
    ).astype(np.float32)
    there, ok, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        corners,
        start[:, None].copy(),
        winSize=(15, 15),
        maxLevel=2,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    back, ok_back, _ = cv2.calcOpticalFlowPyrLK(
        second,
        first,
        there,
        corners.copy(),
        winSize=(15, 15),
        maxLevel=2,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    good = (
        (ok[:, 0] > 0)
        & (ok_back[:, 0] > 0)
        & (np.linalg.norm((back - corners)[:, 0], axis=1) < _BACK_PX)
    )
    return rays[good], _rays(b, there[good, 0])[:, :2]


def _rays(p: Picture, uv: np.ndarray) -> np.ndarray:
    c = p.camera
    return np.column_stack([(uv[:, 0] - c.cx) / c.fx, (uv[:, 1] - c.cy) / c.fy, np.ones(len(uv))])


def _rotation(turned: np.ndarray, seen: np.ndarray, t0: np.ndarray, sigma: float):
    """Small rotation (3,) and its covariance (3, 3) that brings rays (N, 3), already turned by the
    prior, where they were seen (N, 2); None where that is not determined.

    Inverse depths are eliminated with their prior, in common and of each corner: residuals may be
    large along the parallax, and a turn that looks like it is hardly told.
    """
    w, rho = np.zeros(3), _INVERSE_DEPTH
    for _ in range(_ROUNDS):
        x, y, z = (turned @ Rotation.from_rotvec(w).as_matrix().T).T
        x, y, z = x / z, y / z, np.ones_like(z)
        parallax = np.column_stack([t0[0] - x * t0[2], t0[1] - y * t0[2]])
        e = seen - np.column_stack([x, y]) - rho * parallax
        J = np.stack(
            [
                np.column_stack([-x * y, 1 + x * x, -y, parallax[:, 0]]),
                np.column_stack([-(1 + y * y), x * y, x, parallax[:, 1]]),
            ],
            axis=1,
        )
        along = _OF_CORNER**2 * np.einsum("ni,nj->nij", parallax, parallax)
        W = np.linalg.inv(along + sigma**2 * np.eye(2))
        distance = np.sqrt(np.einsum("ni,nij,nj->n", e, W, e))
        W = W * np.minimum(1.0, _ROBUST / np.maximum(distance, 1e-9))[:, None, None]
        H = np.einsum("nki,nkl,nlj->ij", J, W, J)
        g = np.einsum("nki,nkl,nl->i", J, W, e)
        H[3, 3] += _OF_SCENE**-2
        g[3] += (_INVERSE_DEPTH - rho) * _OF_SCENE**-2
        try:
            step = np.linalg.solve(H, g)
        except np.linalg.LinAlgError:
            return None
        w, rho = (
            (Rotation.from_rotvec(step[:3]) * Rotation.from_rotvec(w)).as_rotvec(),
            rho + step[3],
        )
    return w, np.linalg.inv(H)[:3, :3]
