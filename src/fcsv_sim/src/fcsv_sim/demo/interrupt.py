# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C, so that vehicles land and processes stop whenever it comes."""

import signal

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(BaseException):
    """Ctrl-C, or SIGTERM from whoever started the demo; no Exception, since rospy would swallow it."""


def listen() -> None:
    """From now on either raises Interrupted in the main thread."""
    for number in _SIGNALS:
        signal.signal(number, _interrupt)


def uninterrupted(action) -> None:
    """Run to the end: an impatient Ctrl-C must not leave half a fleet behind."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    try:
        action()
    finally:
        listen()


def _interrupt(_number, _frame) -> None:
    raise Interrupted
