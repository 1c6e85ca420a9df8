# SPDX-License-Identifier: Apache-2.0
"""A process without its transport: messages and monotonic time in, messages out.

A ROS node is an adapter of a port: it converts, subscribes, publishes. The rehearsal's bus is
another one.
"""

from typing import Protocol, Sequence


class Port(Protocol):
    """Messages are frozen dataclasses; ``now_s`` is this machine's monotonic time."""

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where the port does not know its type."""

    def step(self, now_s: float) -> Sequence[object]:
        """What is to be sent now."""


class ServingPort(Port, Protocol):
    """A port that also answers: a ROS service is asked, and its caller waits."""

    def serve(self, now_s: float, request: object) -> Sequence[object]:
        """What is to be sent now, the Reply among it. Raises TypeError where the request's type is
        not known."""
