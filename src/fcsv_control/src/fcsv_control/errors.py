# SPDX-License-Identifier: Apache-2.0
"""Errors of control."""

from fcsv_geometry.errors import FcsvError


class ControlError(FcsvError):
    """Base of all errors of this package."""


class LinkError(ControlError):
    """The flight controller does not answer, or cannot be reached."""


class CommandRefused(ControlError):
    """The flight controller or the agent refused; the message is the reason."""


class SessionError(ControlError):
    """A session folder is not what session.yaml says, or cannot be recorded into."""


class ProfileError(ControlError):
    """A file of an autopilot's parameters is not what it should be; the message names file and
    line."""
