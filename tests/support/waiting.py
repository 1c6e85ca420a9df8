# SPDX-License-Identifier: Apache-2.0
"""Waiting in tests for what another process or thread brings about."""

import time


def within(usual_s):
    """A function that waits for an event, at most ``usual_s`` unless told otherwise.

    until(condition, timeout_s=usual_s, what="", meanwhile=None, every_s=0.02) -> what the condition
    returned once it was true. ``meanwhile()`` is called before each further look, which comes after
    ``every_s``. AssertionError once ``timeout_s`` passed, with ``what``, a text or a function that
    returns one.
    """

    def until(condition, timeout_s=usual_s, what="", meanwhile=None, every_s=0.02):
        deadline = time.monotonic() + timeout_s
        while True:
            found = condition()
            if found:
                return found
            assert time.monotonic() < deadline, (
                f"did not come within {timeout_s:g} s: {what() if callable(what) else what}"
            )
            if meanwhile is not None:
                meanwhile()
            time.sleep(every_s)

    return until
