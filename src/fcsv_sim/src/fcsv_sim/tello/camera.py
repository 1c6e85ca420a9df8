# SPDX-License-Identifier: Apache-2.0
"""The Tello's side of its camera's process: starts it, tells it what the client wants, sends what
it took when due."""

import json
import logging
import subprocess
import threading
from collections import deque
from dataclasses import asdict
from typing import Deque, Optional, Tuple

from fcsv_sim.tello.pictures import HEAD, Orders, VideoTask
from fcsv_sim.tello.vehicle import TelloDrone
from fcsv_sim.tello.video import BIT_RATES, Packets

_LOG = logging.getLogger(__name__)
_AGAIN_S = 2.0  # a process that died is started again, not more often


class Camera:
    """step() every pass; ends its process with close()."""

    def __init__(self, task: VideoTask):
        self._task, self._packets = task, Packets()
        self._lock = threading.Lock()
        self._taken: Deque[Tuple[float, bytes]] = deque()
        self._orders, self._keys = Orders(), 0
        self._started_s = float("-inf")
        self._process: Optional[subprocess.Popen] = None
        self.sent = self.too_large = 0

    def step(self, now_s: float, drone: TelloDrone) -> None:
        """Pictures that are old enough go on their way."""
        self._order(now_s, drone)
        delay_s = self._task.video.delay_s
        with self._lock:
            due = []
            while self._taken and self._taken[0][0] + delay_s <= now_s:
                due.append(self._taken.popleft()[1])
        for picture in due:
            datagrams = self._packets.cut(picture)
            if not datagrams:
                self.too_large += 1
                drone.drone.key_picture_wanted = True
            drone.sent_video(now_s, datagrams)
            self.sent += bool(datagrams)

    @property
    def pid(self) -> Optional[int]:
        """Gives the number of its process."""
        return self._process.pid if self._process else None

    def _order(self, now_s: float, drone: TelloDrone) -> None:
        wanted = drone.drone
        if wanted.key_picture_wanted:
            self._keys, wanted.key_picture_wanted = self._keys + 1, False
        orders = Orders(drone.link.video_to is not None, BIT_RATES[wanted.encoder_rate], self._keys)
        dead = self._process is None or self._process.poll() is not None
        if dead and now_s - self._started_s > _AGAIN_S:
            self._start(now_s)
        elif orders == self._orders:
            return
        self._orders = orders
        try:
            self._process.stdin.write(json.dumps(asdict(orders)).encode() + b"\n")
        except (BrokenPipeError, ValueError):
            self._orders = Orders()  # it has died: told again once it is there again

    def _start(self, now_s: float) -> None:
        if self._process is not None:
            _LOG.error(
                "%s: its camera died (%s); started again",
                self._task.vehicle,
                self._process.returncode,
            )
            self._end()
        self._started_s = now_s
        self._process = subprocess.Popen(
            self._task.command(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,
        )
        threading.Thread(
            target=self._read, args=(self._process,), name="camera", daemon=True
        ).start()

    def _read(self, process: subprocess.Popen) -> None:
        while True:
            head = _whole(process.stdout, HEAD.size)
            if head is None:
                return
            stamp_s, length = HEAD.unpack(head)
            data = _whole(process.stdout, length)
            if data is None:
                return
            with self._lock:
                self._taken.append((stamp_s, data))

    def _end(self) -> None:
        self._process.stdin.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def close(self) -> None:
        """Its process ends with its input."""
        if self._process is not None:
            self._end()


def _whole(stream, length: int) -> Optional[bytes]:
    """So many bytes; None where the stream ends before."""
    data = b""
    while len(data) < length:
        piece = stream.read(length - len(data))
        if not piece:
            return None
        data += piece
    return data
