# SPDX-License-Identifier: Apache-2.0
"""Machines in network namespaces, as the bench makes them; skipped where this machine permits none."""

import sys

import pytest


@pytest.fixture(scope="session")
def bench_link(root):
    """The modules of tools/bench_link: (machines, radio)."""
    sys.path.insert(0, str(root / "tools" / "bench_link"))
    import machines
    import radio

    if not radio.can_emulate():
        pytest.skip("needs root, /dev/net/tun and network namespaces")
    return machines, radio
