# SPDX-License-Identifier: Apache-2.0
"""What several tests of stereo use."""

from concurrent.futures import ThreadPoolExecutor

import pytest


@pytest.fixture(scope="session")
def pool():
    """Two threads, as many as a map is made with."""
    with ThreadPoolExecutor(2) as threads:
        yield threads
