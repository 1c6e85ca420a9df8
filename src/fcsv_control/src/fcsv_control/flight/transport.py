# SPDX-License-Identifier: Apache-2.0
"""A pymavlink connection that may be sent on from any thread, and that is opened again after a device was pulled."""

import os

os.environ.setdefault("MAVLINK20", "1")

import logging
import threading
import time

from pymavlink import mavutil

from fcsv_control.errors import LinkError
from fcsv_control.flight.requests import COMPANION

_LOG = logging.getLogger(__name__)
_REOPEN_S = 1.0


class Transport:
    """``url``: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or /dev/DEVICE:BAUD. Raises LinkError at first."""

    def __init__(self, url: str):
        self._url = url
        self._sending = threading.Lock()
        self._broken = False
        self._open()

    def receive(self, timeout_s: float):
        """The next message, or None after about ``timeout_s``. From one thread only."""
        if self._broken:
            return self._reopen()
        try:
            return self._link.recv_match(blocking=True, timeout=timeout_s)
        except (OSError, ValueError, TypeError) as error:  # what pyserial and select raise when a device is pulled
            _LOG.warning("flight controller at '%s' is gone (%s); opening it again", self._url, error)
            self._broken = True
            return None

    def send(self, message) -> None:
        """A message with the source that its header names; what cannot be sent is lost, as on any link."""
        with self._sending:
            if self._broken:
                return
            try:
                mav = self._link.mav
                mav.srcSystem, mav.srcComponent = message.get_srcSystem(), message.get_srcComponent()
                mav.send(message)
            except (OSError, RuntimeError) as error:  # RuntimeError: a new UDP peer came while the peers were counted
                _LOG.debug("%s not sent: %s", message.get_type(), error)

    def close(self) -> None:
        with self._sending:
            self._broken = True
            self._link.close()

    def _open(self) -> None:
        device, _, baud = self._url.rpartition(":")
        options = {"source_system": 1, "source_component": COMPANION, "dialect": "ardupilotmega"}
        try:
            if device.startswith("/"):
                self._link = mavutil.mavlink_connection(device, baud=int(baud), **options)
            else:
                self._link = mavutil.mavlink_connection(self._url, autoreconnect=self._url.startswith("tcp"), **options)
        except (OSError, ValueError) as error:
            raise LinkError(
                f"flight controller at '{self._url}' cannot be opened ({error}); "
                "give udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or /dev/DEVICE:BAUD"
            ) from error

    def _reopen(self) -> None:
        time.sleep(_REOPEN_S)
        with self._sending:
            try:
                self._link.close()
                self._open()
                self._broken = False
                _LOG.info("flight controller at '%s' is open again", self._url)
            except (LinkError, OSError) as error:
                _LOG.debug("%s", error)
