# SPDX-License-Identifier: Apache-2.0
"""One flight that several tests look at."""

import pytest
from support.window_flight import WindowFlight


@pytest.fixture(scope="session")
def operated(tmp_path_factory, root):
    """(folder, what the operator saw) of a demo flown from the operator's window and mapped to its
    end."""
    out = tmp_path_factory.mktemp("demo")
    return out, WindowFlight(out, root / "config" / "missions" / "short.yaml").fly()


@pytest.fixture(scope="session")
def flown(operated):
    return operated[0]
