# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C, so that vehicles land and processes stop whenever it comes."""

import signal

from fcsv_geometry.programs.interruption import leave_it, raise_again

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(BaseException):
    """Ctrl-C, or SIGTERM from whoever started the demo; no Exception, since rospy would swallow
    it."""


def listen() -> None:
    """Takes care that from now on either raises Interrupted in the main thread."""
    raise_again(Interrupted)
    _listen()


def uninterrupted(action) -> None:
    """Run to the end: an impatient Ctrl-C must not leave half a fleet behind."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    leave_it()
    try:
        action()
    finally:
        _listen()


def _listen() -> None:
    for number in _SIGNALS:
        signal.signal(number, _interrupt)


def _interrupt(_number, _frame) -> None:
    raise Interrupted
