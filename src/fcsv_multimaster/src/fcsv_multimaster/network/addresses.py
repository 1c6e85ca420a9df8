# SPDX-License-Identifier: Apache-2.0
"""The addresses of this machine, and whether they have changed: discovery must then start again
from the new one."""

import socket
from pathlib import Path
from typing import Callable, FrozenSet

_ROUTES = Path("/proc/net/fib_trie")  # of the process's own network namespace


def local_addresses() -> FrozenSet[str]:
    """The IPv4 addresses of this machine but loopback; discovery knows no others."""
    lines = _ROUTES.read_text().splitlines()
    found = {before.split()[-1] for before, line in zip(lines, lines[1:]) if "host LOCAL" in line}
    return frozenset(a for a in found if not a.startswith("127."))


def whereabouts() -> str:
    """This machine in words, for others who wonder which one it is."""
    try:
        addresses = ", ".join(sorted(local_addresses()))
    except OSError:
        addresses = ""
    return f"host {socket.gethostname()} at {addresses or 'loopback'}"


class AddressWatch:
    """Look now and then; an address that is only gone changes nothing, as nothing can be reached
    without one."""

    def __init__(self, read: Callable[[], FrozenSet[str]] = local_addresses):
        self._read = read
        self._known = self._last = read()

    def changed(self) -> bool:
        """True once when there are other addresses, and they were the same at the look before."""
        now = self._read()
        settled, self._last = now == self._last, now
        if not now or not settled or now == self._known:
            return False
        self._known = now
        return True
