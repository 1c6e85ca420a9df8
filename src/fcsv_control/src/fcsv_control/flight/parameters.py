# SPDX-License-Identifier: Apache-2.0
"""The autopilot's parameters that flying on external navigation relies on: read and reported, not changed silently."""

from typing import Callable, Dict, List, Optional, Tuple

#: What this flies on, the preferred value first. The pose that is sent is the body's: no mounting offset.
NEEDED: Dict[str, Tuple[float, ...]] = {
    "AHRS_EKF_TYPE": (3,),
    "EK3_ENABLE": (1,),
    "VISO_TYPE": (2, 3),
    "VISO_ORIENT": (0,),
    "VISO_POS_X": (0,),
    "VISO_POS_Y": (0,),
    "VISO_POS_Z": (0,),
    "EK3_SRC1_POSXY": (6,),
    "EK3_SRC1_POSZ": (6, 1),
    "EK3_SRC1_VELXY": (6, 0),
    "EK3_SRC1_VELZ": (6, 0),
    "EK3_SRC1_YAW": (6,),
}
#: What the autopilot's own failsafes should do, because they alone act where the companion or its link is dead, and in
#: modes that the pilot chose: whether a value fits, and what is wrong where it does not.
ADVISED: Dict[str, Tuple[Callable[[float], bool], str]] = {
    "BATT_FS_LOW_ACT": (lambda v: v >= 1, "a low battery does nothing: 1 lands"),
    "BATT_FS_CRT_ACT": (lambda v: v >= 1, "an empty battery does nothing: 1 lands"),
    "FS_THR_ENABLE": (lambda v: v >= 1, "a lost transmitter does nothing, and LOITER without one falls: 3 lands"),
    "FS_EKF_ACTION": (lambda v: v in (1, 3), "a lost position does not land: 1 lands"),
    "FS_EKF_THRESH": (lambda v: 0 < v <= 1.0, "a lost position is noticed late or never: 0.8"),
    "FENCE_ENABLE": (lambda v: v >= 1, "the autopilot has no fence: 1"),
    "FENCE_ACTION": (lambda v: v >= 1, "its fence only reports: 2 lands"),
}
_TRIES = 5
_TOLERANCE = 1e-6  # parameters travel as float32


class ParameterCheck:
    """Which parameters are still to be read, and what is wrong with those that were."""

    def __init__(self):
        self._values: Dict[str, float] = {}
        self._asked: Dict[str, int] = dict.fromkeys([*NEEDED, *ADVISED], 0)

    def begin(self) -> None:
        """Read all again: the autopilot may have been changed or restarted."""
        self.__init__()

    def next(self) -> Optional[str]:
        """The name to ask for now, one at a time; None when done. An unknown name gets no answer: asked some times."""
        waiting = [n for n in self._asked if n not in self._values and self._asked[n] < _TRIES]
        if not waiting:
            return None
        name = min(waiting, key=self._asked.get)
        self._asked[name] += 1
        return name

    def answer(self, name: str, value: float) -> bool:
        """Note a PARAM_VALUE; whether it is one of ours and not what is needed."""
        if name in self._asked:
            self._values[name] = value
        return name in NEEDED and not _fits(name, value)

    @property
    def known(self) -> bool:
        """Whether all that is needed was answered."""
        return all(n in self._values for n in NEEDED)

    def wrong(self) -> Dict[str, float]:
        """Name and value of parameters that do not fit."""
        return {n: v for n, v in self._values.items() if n in NEEDED and not _fits(n, v)}

    def problems(self) -> List[str]:
        """One line for each parameter that does not fit or that the autopilot does not have."""
        silent = [n for n in NEEDED if n not in self._values and self._asked[n] >= _TRIES]
        lines = [f"{n} is {v:g}, external navigation needs {_choice(n)}" for n, v in self.wrong().items()]
        return lines + [f"{n} was not answered: does this firmware have it?" for n in silent]

    def warnings(self) -> List[str]:
        """One line for each failsafe of the autopilot that would not act."""
        wrong = [n for n, (fits, _) in ADVISED.items() if n in self._values and not fits(self._values[n])]
        return [f"{n} is {self._values[n]:g}: {ADVISED[n][1]}" for n in wrong]


def _fits(name: str, value: float) -> bool:
    return any(abs(value - allowed) < _TOLERANCE for allowed in NEEDED[name])


def _choice(name: str) -> str:
    return " or ".join(f"{v:g}" for v in NEEDED[name])
