# SPDX-License-Identifier: Apache-2.0
"""Network namespaces for devices that all have the same address, as Tellos have: one for the
device, one for its pilot.

Each pair is joined by a virtual cable (veth). A process may stay where it is, with its ROS master,
and open single sockets inside (fcsv_geometry.programs.netns). Root is needed, or CAP_SYS_ADMIN and
CAP_NET_ADMIN.
"""

import contextlib
import os
import subprocess
import threading
from dataclasses import dataclass
from typing import Iterator, List, Sequence

from fcsv_geometry.programs.netns import FOLDER, NamespaceError, exists, inside

_numbers = iter(range(1, 1 << 20))
_LOCK = threading.Lock()


@dataclass(frozen=True)
class NamespacePair:
    """Names of the two namespaces, and the addresses in them."""

    device: str
    pilot: str
    device_address: str
    pilot_address: str


def _ip(*words: str) -> None:
    """The command ``ip``. Raises NamespaceError with what it said."""
    try:
        done = subprocess.run(["ip", *words], capture_output=True, text=True)
    except FileNotFoundError as error:
        raise NamespaceError("there is no command 'ip': install iproute2") from error
    if done.returncode:
        said = done.stderr.strip().splitlines()[-1:] or ["no reason given"]
        raise NamespaceError(f"ip {' '.join(words)}: {said[0]}")


def permitted() -> str:
    """Empty where namespaces can be made and joined here; otherwise why not, and what to do."""
    try:
        with pair("probe", "192.168.10.1", "192.168.10.2") as made, inside(made.device):
            return ""
    except NamespaceError as error:
        return f"no network namespaces here ({error}): run as root, or give each simulated Tello an address of its own"


@contextlib.contextmanager
def pair(name: str, device_address: str, pilot_address: str) -> Iterator[NamespacePair]:
    """Two namespaces joined by a cable, each with its address (/24), removed again at the end of
    the block.

    They are removed as well when this process dies, whatever kills it: a small process that
    outlives it does that. Raises NamespaceError.
    """
    with _LOCK:
        stem = f"fcsv-{os.getpid()}-{next(_numbers)}-{name}"
    with named(stem, device_address, pilot_address) as made:
        yield made


@contextlib.contextmanager
def named(stem: str, device_address: str, pilot_address: str) -> Iterator[NamespacePair]:
    """The same with names that others can know before: STEM-device and STEM-pilot.

    Where they are there already they are used, and stay. Raises NamespaceError.
    """
    sweep()
    made = NamespacePair(f"{stem}-device", f"{stem}-pilot", device_address, pilot_address)
    if exists(made.device) and exists(made.pilot):
        yield made
        return
    guard = _guard(made)
    try:
        _join(made)
        yield made
    finally:
        guard.stdin.close()
        guard.wait()


def _join(made: NamespacePair) -> None:
    _ip("netns", "add", made.device)
    _ip("netns", "add", made.pilot)
    _ip(
        "-n",
        made.device,
        "link",
        "add",
        "wlan0",
        "type",
        "veth",
        "peer",
        "name",
        "wlan0",
        "netns",
        made.pilot,
    )
    for space, address in ((made.device, made.device_address), (made.pilot, made.pilot_address)):
        _ip("-n", space, "address", "add", f"{address}/24", "dev", "wlan0")
        _ip("-n", space, "link", "set", "lo", "up")
        _ip("-n", space, "link", "set", "wlan0", "up")


def _guard(made: NamespacePair) -> subprocess.Popen:
    """A process that removes both once its input is closed: by us, or by the kernel when we are
    dead."""
    script = 'cat > /dev/null; for space; do ip netns del "$space" 2> /dev/null; done'
    return subprocess.Popen(
        ["sh", "-c", script, "sh", made.device, made.pilot],
        stdin=subprocess.PIPE,
        start_new_session=True,
    )


def _remove(space: str) -> None:
    with contextlib.suppress(NamespaceError):  # it is not there
        _ip("netns", "del", space)


def left_behind(names: Sequence[str]) -> List[str]:
    """Which of these namespaces belong to a process of this workspace that is no more.

    >>> left_behind(["fcsv-999999999-1-tello1-pilot", "vpn", f"fcsv-{os.getpid()}-1-a-pilot"])
    ['fcsv-999999999-1-tello1-pilot']
    """
    owners = {
        name: name.split("-")[1]
        for name in names
        if name.startswith("fcsv-") and name.count("-") >= 4
    }
    return [
        name for name, pid in owners.items() if pid.isdigit() and not os.path.exists(f"/proc/{pid}")
    ]


def sweep() -> None:
    """Remove what killed processes left behind."""
    names = os.listdir(FOLDER) if os.path.isdir(FOLDER) else []
    for name in left_behind(names):
        _remove(name)
