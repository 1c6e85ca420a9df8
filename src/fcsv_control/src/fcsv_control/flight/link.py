# SPDX-License-Identifier: Apache-2.0
"""One flight controller behind MAVLink 2: a thread and a connection around the link's port.

One thread reads and lets time pass; any thread may tell and ask.
"""

import itertools
import logging
import threading
import time
from typing import Callable, Dict, Optional, Union

from fcsv_control.agent.messages import Ask, Kind
from fcsv_control.errors import LinkError
from fcsv_control.flight.mavlink.transport import Transport
from fcsv_control.flight.messages import FromAutopilot, RequestOver, ToAutopilot
from fcsv_control.flight.port import FlightLinkPort

_LOG = logging.getLogger(__name__)
_POLL_S = 0.05


class FlightLink:
    """``tell`` is called with what the port gives, in its order, by whichever thread let it give
    that.

    ``line`` is an address as Transport has it, or what has Transport's ``receive``, ``send`` and
    ``close``. Raises LinkError where the address cannot be opened.
    """

    def __init__(
        self, line: Union[str, Transport], port: FlightLinkPort, tell: Callable[[object], None]
    ):
        self._port, self._tell = port, tell
        self._over: Dict[int, RequestOver] = {}
        self._numbers = itertools.count(1)
        self._changed = threading.Condition()  # guards the port
        self._transport = Transport(line) if isinstance(line, str) else line
        self._running = True
        self._thread = threading.Thread(target=self._read, name="mavlink", daemon=True)
        self._thread.start()

    def receive(self, message: object) -> None:
        """A message for the port came."""
        with self._changed:
            now_s = time.monotonic()
            self._port.receive(now_s, message)
            self._step(now_s)

    def ask(self, kind: Kind, **what) -> None:
        """What an Ask says; until it is over. Raises CommandRefused with the reason, or
        LinkError."""
        number = next(self._numbers)
        with self._changed:
            self.receive(Ask(kind, number=number, **what))
            while number not in self._over and self._running:
                self._changed.wait(_POLL_S)
                self._step(time.monotonic())
            over: Optional[RequestOver] = self._over.pop(number, None)
        if over is None:
            raise LinkError("the flight link was closed")
        over.require_done()

    def close(self) -> None:
        """End the thread, close the connection."""
        self._running = False
        self._thread.join(3.0)
        self._transport.close()

    def _read(self) -> None:
        while self._running:
            message = None
            try:
                message = self._transport.receive(_POLL_S)
                with self._changed:
                    now_s = time.monotonic()
                    if message is not None:
                        self._port.receive(now_s, FromAutopilot(message))
                    self._step(now_s)
            except Exception:  # one odd message must not end the link of a flying vehicle
                _LOG.exception("while handling %s", message)

    def _step(self, now_s: float) -> None:
        for output in self._port.step(now_s):
            if isinstance(output, ToAutopilot):
                self._transport.send(output.message)
            elif isinstance(output, RequestOver):
                self._over[output.number] = output
                self._changed.notify_all()
            else:
                self._on_output(output)

    def _on_output(self, output: object) -> None:
        try:
            self._tell(output)
        except Exception:  # a node that is going down must not end the link of a flying vehicle
            if self._running:
                _LOG.exception("while telling %s", output)
