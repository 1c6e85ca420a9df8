# SPDX-License-Identifier: Apache-2.0
"""The line to an autopilot through MAVROS: what it hears is mavlink/from, what it is to send
mavlink/to."""

import os

os.environ.setdefault("MAVLINK20", "1")

import logging
import queue
import time

import rospy
from pymavlink import mavutil

from fcsv_control.flight.mavlink import frame_bytes
from mavros_msgs.msg import Mavlink

_LOG = logging.getLogger(__name__)
_MOST = 500  # messages that wait: some seconds of all streams


class MavrosLine:
    """``receive``, ``send`` and ``close`` as a Transport has them. ``heard_s``: when MAVROS was
    heard last."""

    def __init__(self):
        self.heard_s = float("-inf")
        self._came: queue.Queue[Mavlink] = queue.Queue(_MOST)
        self._parser, self._packer = mavutil.mavlink.MAVLink(None), mavutil.mavlink.MAVLink(None)
        self._to = rospy.Publisher("mavlink/to", Mavlink, queue_size=100, tcp_nodelay=True)
        self._from = rospy.Subscriber(
            "mavlink/from", Mavlink, self._on_message, queue_size=_MOST, tcp_nodelay=True
        )

    @property
    def there(self) -> bool:
        """Whether a MAVROS listens."""
        return self._to.get_num_connections() > 0

    def receive(self, timeout_s: float):
        """The next message that came whole, or None after about ``timeout_s``."""
        try:
            m = self._came.get(timeout=timeout_s)
        except queue.Empty:
            return None
        if m.magic != Mavlink.MAVLINK_V20 or m.framing_status != Mavlink.FRAMING_OK:
            return None
        try:
            frame = frame_bytes.to_frame(
                m.len,
                m.incompat_flags,
                m.compat_flags,
                m.seq,
                m.sysid,
                m.compid,
                m.msgid,
                m.checksum,
                m.payload64,
                m.signature,
            )
            return self._parser.decode(bytearray(frame))
        except (ValueError, mavutil.mavlink.MAVError) as error:
            _LOG.debug("message %d of MAVROS is passed over: %s", m.msgid, error)
            return None

    def send(self, message) -> None:
        """A message with the source that its header names; lost where no MAVROS listens."""
        packer = self._packer
        packer.srcSystem, packer.srcComponent = message.get_srcSystem(), message.get_srcComponent()
        fields = frame_bytes.to_fields(message.pack(packer))
        packer.seq = (packer.seq + 1) % 256
        out = Mavlink(framing_status=Mavlink.FRAMING_OK, **fields)
        out.header.stamp = rospy.Time.from_sec(time.time())
        self._to.publish(out)

    def close(self) -> None:
        self._from.unregister()
        self._to.unregister()

    def _on_message(self, message: Mavlink) -> None:
        self.heard_s = time.monotonic()
        try:
            self._came.put_nowait(message)
        except queue.Full:
            _LOG.warning("more than %d messages of MAVROS wait: the newest is dropped", _MOST)
