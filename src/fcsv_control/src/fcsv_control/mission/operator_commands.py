# SPDX-License-Identifier: Apache-2.0
"""What the operator tells a mission: confirmations, which configurations to fly, pause, skip and the
like."""

from typing import Sequence

from fcsv_control.mission.machine import MissionMachine

OPERATIONS = (
    *("pause", "resume", "skip", "repeat", "next", "previous"),
    *("skip_station", "repeat_station", "resume_station", "abort"),
)
_CONFIRMED_ONCE_S = 1.0  # a second confirmation within this time is a slip of the finger


class OperatorCommands:
    """Takes what people tell a mission; each method answers "" when it is done, else why not."""

    def __init__(self, machine: MissionMachine):
        self._machine = machine
        self._confirmed_s = float("-inf")

    def proceed(self, step: str) -> str:
        """The operator confirms the step that he names."""
        return self._proceed(step, ())

    def execute(self, indices: Sequence[int]) -> str:
        """Begins the list as ``proceed("execute")``, for these configurations in this order (none:
        all)."""
        m = self._machine
        most = len(m.mission.configurations) - 1
        wrong = [i for i in indices if not 0 <= i <= most]
        if wrong or len(set(indices)) != len(indices):
            return f"configurations are numbered 0..{most}, each once; got {list(indices)}"
        if m.waits_for != "execute" and not m.lost:
            return f"'execute' is not waited for in {m.phase}"
        return self._proceed("execute", indices)

    def _resume_station(self) -> str:
        """Begins the list at the station at which a flight before stopped."""
        m = self._machine
        if m.waits_for != "execute":
            return f"'resume_station' takes the place of 'execute', once home is set ({m.phase})"
        if not m.unfinished:
            return "no station is left of a flight before; 'execute' flies all"
        return self._proceed("execute", m.unfinished, resumes=True)

    def _proceed(self, step: str, indices: Sequence[int], resumes: bool = False) -> str:
        m = self._machine
        if m.now_s - self._confirmed_s < _CONFIRMED_ONCE_S:
            return "the step before was confirmed a moment ago; look at the vehicles, then confirm again"
        if m.lost and m.phase != "LAND":
            return f"'{step}' is refused: {m.lost}"
        if not m.waits_for:
            return f"nothing is waited for in {m.phase}"
        if step != m.waits_for:
            return f"'{m.waits_for}' is waited for, not '{step}'"
        if step == "execute":
            refusal = m.begin_list(indices, resumes)
        elif step == "resume":
            refusal = m.resume()
        else:
            refusal = m.call(step)
        if not refusal:
            self._confirmed_s = m.now_s
        return refusal

    def control(self, operation: str) -> str:
        """One of OPERATIONS."""
        m = self._machine
        if operation == "abort":
            if m.over:
                return f"the mission is over ({m.phase})"
            m.abort("aborted by the operator: landing")
            return ""
        if operation not in OPERATIONS:
            return f"'{operation}' is not one of {', '.join(OPERATIONS)}"
        if operation == "resume_station":
            return self._resume_station()
        return self.proceed("resume") if operation == "resume" else m.change(operation)
