# SPDX-License-Identifier: Apache-2.0
"""Waiting in tests for what another process or thread brings about."""

import time


def within(usual_s):
    """until(condition, timeout_s=usual_s, what=""): returns once the condition holds, else an
    assertion error."""

    def until(condition, timeout_s=usual_s, what=""):
        deadline = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline, f"did not come: {what}"
            time.sleep(0.02)

    return until
