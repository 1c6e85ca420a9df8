# SPDX-License-Identifier: Apache-2.0
"""One flight that several tests look at."""

import pytest
from support.demos import FLIGHT_LIMIT_S, said, start_demo


@pytest.fixture(scope="session")
def flown(tmp_path_factory):
    """A demo flown and mapped to its end."""
    out = tmp_path_factory.mktemp("demo")
    demo = start_demo(out, "--mission", "short", "--seed", "1")
    try:
        status = demo.wait(FLIGHT_LIMIT_S + 200)
    finally:
        demo.kill()
    assert status == 0, said(out)[-4000:]
    return out
