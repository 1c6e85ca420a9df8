# SPDX-License-Identifier: Apache-2.0
"""A radio for network namespaces: each machine has a TUN device, this process carries packets
between them.

It loses, delays, duplicates, reorders, limits and cuts in user space, so it needs no netem in the
kernel, but root and /dev/net/tun. Loss is independent per packet: harder than real Wi-Fi, which
repeats unicast and loses in bursts.
"""

import fcntl
import heapq
import os
import random
import select
import socket
import struct
import subprocess
import threading
import time
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Optional, Set, Tuple

from fcsv_geometry.programs import netns

_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_MTU = 1500


@dataclass(frozen=True)
class Conditions:
    """Of every packet on its way. ``rate_bit_s`` 0: no limit; ``queue_s``: of the limited sender,
    then tail drop."""

    loss: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    duplicate: float = 0.0
    rate_bit_s: float = 0.0
    queue_s: float = 0.1


def can_emulate() -> bool:
    """Whether this process may make namespaces and TUN devices."""
    if os.geteuid() != 0 or not os.access("/dev/net/tun", os.R_OK | os.W_OK):
        return False
    name = f"fcsv-probe-{os.getpid()}"
    if subprocess.run(["ip", "netns", "add", name], capture_output=True).returncode != 0:
        return False
    subprocess.run(["ip", "netns", "del", name], check=True)
    return True


class Radio:
    """Namespaces NAME-PID with addresses 10.77.0.N; closes by itself at the end of a with block.

    Delays go by ``clock`` (s), which may be slower than real time, never faster.
    """

    def __init__(
        self,
        machines,
        conditions: Optional[Conditions] = None,
        seed: int = 1,
        congestion: str = "",
        clock: Callable[[], float] = time.monotonic,
    ):
        self._clock = clock
        self._random = random.Random(seed)
        self.conditions = conditions or Conditions()
        self._cut: Set[Tuple[str, str]] = set()
        self.names = tuple(machines)
        self.addresses = {n: f"10.77.0.{i + 1}" for i, n in enumerate(self.names)}
        self.carried = self.lost = 0
        self._fds: Dict[str, int] = {}
        self._free_s: Dict[str, float] = {}
        self._queue: List[Tuple[float, int, str, bytes]] = []
        self._count = 0
        self._stop, self._wake = os.pipe()
        try:
            for name in self.names:
                self._make(name, congestion)
        except BaseException:
            self.close()
            raise
        self._thread: Optional[threading.Thread] = threading.Thread(
            target=self._run, name="radio", daemon=True
        )
        self._thread.start()

    def namespace(self, name: str) -> str:
        return f"fcsv-{name}-{os.getpid()}"

    def set(self, **changes) -> None:
        """Change some of the conditions, from now on."""
        self.conditions = replace(self.conditions, **changes)

    def cut(self, *pairs: Tuple[str, str]) -> None:
        """Nothing goes from the first to the second of each pair any more; no pair: nothing at
        all."""
        self._cut |= set(pairs) or {(a, b) for a in self.names for b in self.names}

    def mend(self) -> None:
        self._cut.clear()

    def move(self, name: str, address: str) -> None:
        """The machine has another address now."""
        self._ip(name, "addr", "flush", "dev", "radio0")
        self._ip(name, "addr", "add", f"{address}/24", "dev", "radio0")
        self.addresses[name] = address

    def close(self) -> None:
        """Stop carrying and remove every namespace. Safe to call again."""
        thread, self._thread = getattr(self, "_thread", None), None
        if thread is not None:
            os.write(self._wake, b"x")
            thread.join()
        for fd in self._fds.values():
            os.close(fd)
        self._fds.clear()
        for name in self.names:
            subprocess.run(["ip", "netns", "del", self.namespace(name)], capture_output=True)

    def __enter__(self) -> "Radio":
        return self

    def __exit__(self, *_exc) -> None:
        self.close()

    def _make(self, name: str, congestion: str) -> None:
        namespace = self.namespace(name)
        subprocess.run(["ip", "netns", "add", namespace], check=True)
        self._fds[name] = in_namespace(namespace, _open_tun)
        self._ip(name, "link", "set", "lo", "up")
        self._ip(name, "addr", "add", f"{self.addresses[name]}/24", "dev", "radio0")
        self._ip(name, "link", "set", "radio0", "mtu", str(_MTU), "multicast", "on", "up")
        if congestion:
            self._ip(
                name, "route", "change", "10.77.0.0/24", "dev", "radio0", "congctl", congestion
            )

    def _ip(self, name: str, *arguments: str) -> None:
        subprocess.run(["ip", "-n", self.namespace(name), *arguments], check=True)

    def _run(self) -> None:
        names = {fd: name for name, fd in self._fds.items()}
        while True:
            wait_s = max(0.0, self._queue[0][0] - self._clock()) if self._queue else None
            ready, _, _ = select.select([*names, self._stop], [], [], wait_s)
            if self._stop in ready:
                return
            for fd in ready:
                for _ in range(32):
                    try:
                        packet = os.read(fd, 4096)
                    except BlockingIOError:
                        break
                    self._take(names[fd], packet)
            now_s = self._clock()
            while self._queue and self._queue[0][0] <= now_s:
                _, _, target, packet = heapq.heappop(self._queue)
                self._put(target, packet)

    def _take(self, source: str, packet: bytes) -> None:
        if packet[0] >> 4 != 4:
            return
        address = socket.inet_ntoa(packet[16:20])
        if 224 <= packet[16] < 240:
            targets = [n for n in self.names if n != source]
        else:
            targets = [n for n, a in self.addresses.items() if a == address]
        self.lost += not targets
        for target in targets:
            self._carry(source, target, packet)

    def _carry(self, source: str, target: str, packet: bytes) -> None:
        c = self.conditions
        if (source, target) in self._cut or self._random.random() < c.loss:
            self.lost += 1
            return
        now_s = at_s = self._clock()
        if c.rate_bit_s:
            free_s = max(now_s, self._free_s.get(source, 0.0))
            if free_s - now_s > c.queue_s:
                self.lost += 1
                return
            at_s = self._free_s[source] = free_s + len(packet) * 8 / c.rate_bit_s
        for _ in range(2 if self._random.random() < c.duplicate else 1):
            due_s = at_s + c.delay_s + self._random.random() * c.jitter_s
            if due_s <= now_s:
                self._put(target, packet)
            else:
                self._count += 1
                heapq.heappush(self._queue, (due_s, self._count, target, packet))

    def _put(self, target: str, packet: bytes) -> None:
        try:
            os.write(self._fds[target], packet)
            self.carried += 1
        except OSError:
            self.lost += 1  # the device is full or its address is changing


def in_namespace(namespace: str, work):
    """What ``work()`` returns in a network namespace."""
    with netns.inside(namespace):
        return work()


def _open_tun() -> int:
    fd = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(fd, _TUNSETIFF, struct.pack("16sH22x", b"radio0", _IFF_TUN | _IFF_NO_PI))
    return fd
