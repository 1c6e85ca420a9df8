# SPDX-License-Identifier: Apache-2.0
"""The tree of frames that tf and tf_static of a bag make, and a frame's pose in another at a stamp.
No I/O.
"""

from dataclasses import dataclass, field
from typing import Dict, List, Optional, Tuple, Union

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo.errors import InputError
from fcsv_stereo.sessions.left_out import LeftOut
from fcsv_stereo.sessions.stamped import Stamped
from fcsv_stereo.sessions.tracks import track_of

Edge = Union[np.ndarray, Trajectory]
_SAME = 1e-6


@dataclass
class FrameTree:
    """``edges``: of each child frame its parent and T_parent_child, one (static) or by time."""

    edges: Dict[str, Tuple[str, Edge]] = field(default_factory=dict)

    @property
    def frames(self) -> List[str]:
        return sorted({*self.edges, *(parent for parent, _ in self.edges.values())})

    def require(self, frame: str) -> str:
        """The frame back. Raises InputError that lists those that are there."""
        if frame not in self.frames:
            there = ", ".join(self.frames) or "none"
            raise InputError(f"frame '{frame}' is not in the bag's tf; frames there: {there}")
        return frame

    def root(self, frame: str) -> str:
        """The topmost parent."""
        return (self._up(frame) or [frame])[-1]

    def connected(self, a: str, b: str) -> bool:
        return self.root(a) == self.root(b)

    def at(self, a: str, b: str, stamp_s: float) -> np.ndarray:
        """T_a_b (4, 4) at a stamp (s).

        Raises InputError where the frames are not of one tree, PoseUnavailable where an edge is
        silent at the stamp.
        """
        if not self.connected(a, b):
            raise InputError(
                f"tf does not connect '{a}' and '{b}': their roots are '{self.root(a)}' and '{self.root(b)}'"
            )
        return transforms.invert(self._below(self._to(a, b), stamp_s)) @ self._below(
            self._to(b, a), stamp_s
        )

    def _below(self, children: List[str], stamp_s: float) -> np.ndarray:
        """T of the last in its ancestor: the parent of the first."""
        T = np.eye(4)
        for child in children:
            parent, edge = self.edges[child]
            try:
                T = T @ (edge.at(stamp_s) if isinstance(edge, Trajectory) else edge)
            except PoseUnavailable as error:
                raise PoseUnavailable(f"tf {parent} to {child}: {error}") from error
        return T

    def _to(self, frame: str, other: str) -> List[str]:
        """Child frames from below the nearest common ancestor down to ``frame``."""
        shared = {other, *self._up(other)}
        own = [frame, *self._up(frame)]
        return own[: next(i for i, f in enumerate(own) if f in shared)][::-1]

    def _up(self, frame: str) -> List[str]:
        """Parents, nearest first. Raises InputError where they are a ring."""
        found: List[str] = []
        while frame in self.edges:
            frame = self.edges[frame][0]
            if frame in found:
                raise InputError(f"tf is a ring: '{frame}' is its own parent")
            found.append(frame)
        return found


@dataclass
class FrameCollector:
    """Transforms of a bag as they come, and the tree that they make."""

    static: Dict[str, Tuple[str, np.ndarray]] = field(default_factory=dict)
    moving: Dict[Tuple[str, str], Stamped] = field(default_factory=dict)

    def add(
        self,
        is_static: bool,
        names: Tuple[str, str],
        bag,
        stamp_s: float,
        T_parent_child: np.ndarray,
    ) -> str:
        """A transform of ``names`` (parent, child). Returns a warning, or nothing."""
        parent, child = names
        if not is_static:
            self.moving.setdefault(names, Stamped(f"tf {parent} to {child}")).add(
                bag, stamp_s, T_parent_child
            )
            return ""
        before = self.static.get(child)
        self.static[child] = (parent, T_parent_child)
        if before is None or (
            before[0] == parent and np.allclose(before[1], T_parent_child, atol=_SAME)
        ):
            return ""
        return f"tf_static: '{child}' has several places: the last one, in '{parent}', is used"

    def tree(self, gap_s: Optional[float], left_out: LeftOut, warnings: List[str]) -> FrameTree:
        """Raises InputError where a frame has two parents."""
        edges: Dict[str, Tuple[str, Edge]] = dict(self.static)
        for (parent, child), stamped in self.moving.items():
            if edges.get(child, (parent,))[0] != parent or child in self.static:
                raise InputError(
                    f"tf: frame '{child}' has two parents, '{edges[child][0]}' and '{parent}'"
                )
            for track in track_of(stamped, left_out, warnings):
                edges[child] = (parent, track if gap_s is None else track.bridging(gap_s))
        return FrameTree(edges)
