# SPDX-License-Identifier: Apache-2.0
"""The procedure of connecting, and when to go through it again: after silence, after a reboot, when
streams stop.

All is asked for repeatedly until its effect is seen: an acknowledgement does not promise data, an
origin has none, and a reboot forgets intervals and origin. An origin is asked for again for ever,
because one that was set before the filter began is confirmed and then lost: it counts only while it
goes on being reported.
"""

from typing import Dict, List, Optional

ORIGIN_LASTS_S = 5.0  # asked for every second: four answers may get lost
CONNECTED_S = 3.0  # as MAVROS: connected while a heartbeat is younger than this
HEARTBEAT, STREAMS, ASK_ORIGIN, SET_ORIGIN, PARAMETER = (
    "heartbeat",
    "streams",
    "ask origin",
    "set origin",
    "parameter",
)
VERSION, TIMESYNC = "version", "timesync"
_PERIOD_S = {
    HEARTBEAT: 1.0,
    STREAMS: 0.1,
    ASK_ORIGIN: 1.0,
    SET_ORIGIN: 1.0,
    PARAMETER: 0.1,
    VERSION: 2.0,
    TIMESYNC: 1.0,
}
_SILENT_S = 2.0
# between heartbeats, of which two come a second: the autopilot may have been restarted meanwhile
_GAP_S = 2.5
# what an autopilot that boots answers is not kept
_ONCE_STARTED = frozenset({ASK_ORIGIN, SET_ORIGIN, PARAMETER})
_BOOT_BACK_MS = 1000


class ConnectionKeeper:
    """Told what arrives, it says what to send. Time is given by the caller (s, monotonic)."""

    def __init__(self, streams):
        self._streams: Dict[str, float] = dict.fromkeys(streams, float("-inf"))
        self._asked_s: Dict[str, float] = {}
        self._all_come_s = float("-inf")  # until then no stream can have stopped
        self._heartbeat_s: Optional[float] = None
        self._booting = self._forgotten = False
        self._boot_ms: Optional[int] = None
        self._next_s = dict.fromkeys(_PERIOD_S, float("-inf"))
        self._origin_s = float("-inf")
        self.parameters_read = self.version_known = False

    def connected(self, now_s: float) -> bool:
        """Whether a heartbeat came within the last 3 s."""
        return self._heartbeat_s is not None and now_s - self._heartbeat_s < CONNECTED_S

    def origin_set(self, now_s: float) -> bool:
        """Whether the autopilot reported an origin within the last 5 s, its filter having begun."""
        return now_s - self._origin_s < ORIGIN_LASTS_S

    def origin(self, now_s: float, lasts: bool) -> None:
        """The autopilot reported an origin; ``lasts``: its filter has begun, so that it is not lost
        again."""
        if lasts and not self._forgotten:
            self._origin_s = now_s

    def heartbeat(self, now_s: float, booting: bool) -> bool:
        """A heartbeat came, of an autopilot that is still ``booting`` or not; whether nothing of
        before counts: it is the first one, the first after a gap, or the first that says so."""
        silent = self._heartbeat_s is None or now_s - self._heartbeat_s > _GAP_S
        began = silent or (booting and not self._booting)
        same_firmware = self.version_known and self.connected(now_s) and not booting
        self._heartbeat_s, self._booting, self._forgotten = now_s, booting, False
        if began:
            self.begin_again()
            self.version_known = same_firmware
        return began

    def fell_silent(self, now_s: float) -> bool:
        """Whether nothing of before counts from now on, because no heartbeat has come for too long;
        once. Asked for again it is with the next heartbeat."""
        if self._forgotten or self._heartbeat_s is None or now_s - self._heartbeat_s <= _GAP_S:
            return False
        self._forgotten, self._origin_s = True, float("-inf")
        return True

    def stream(self, now_s: float, name: str, boot_ms: Optional[int] = None) -> bool:
        """A message of a stream came; whether its time since boot went back, that is, it was
        rebooted."""
        if name in self._streams:
            self._streams[name] = now_s
        if boot_ms is None:
            return False
        rebooted = self._boot_ms is not None and boot_ms < self._boot_ms - _BOOT_BACK_MS
        self._boot_ms = boot_ms
        if rebooted:
            self.begin_again()
        return rebooted

    def _stopped(self, now_s: float) -> List[str]:
        """Streams of which nothing came for two seconds, and that were not asked for meanwhile."""
        if now_s < self._all_come_s:
            return []  # as it is 50 times a second
        oldest_s = min(self._streams.values(), default=now_s)
        self._all_come_s = oldest_s + _SILENT_S
        if now_s - oldest_s <= _SILENT_S:
            return []
        since = {
            name: max(last_s, self._asked_s.get(name, last_s))
            for name, last_s in self._streams.items()
        }
        return [name for name, since_s in since.items() if now_s - since_s > _SILENT_S]

    def streams_to_ask(self, now_s: float) -> List[str]:
        """Streams that have stopped; they are asked for now."""
        stopped = self._stopped(now_s)
        self._asked_s.update(dict.fromkeys(stopped, now_s))
        return stopped

    def begin_again(self) -> None:
        """Nothing that was set up may be relied on any more."""
        self.parameters_read = self.version_known = False
        self._streams = dict.fromkeys(self._streams, float("-inf"))
        self._asked_s, self._all_come_s = {}, float("-inf")
        self._origin_s = float("-inf")
        self._boot_ms = None
        for name in (STREAMS, ASK_ORIGIN, PARAMETER, VERSION, TIMESYNC):
            self._next_s[name] = float("-inf")
        # asked for first: an autopilot in flight, met by a restarted link, has its origin
        self._next_s[SET_ORIGIN] = (self._heartbeat_s or 0.0) + 0.5

    def due(self, now_s: float) -> List[str]:
        """What to send now."""
        due = [
            name
            for name, next_s in self._next_s.items()
            if now_s >= next_s and not self._known(now_s, name)
        ]
        for name in due:
            self._next_s[name] = now_s + _PERIOD_S[name]
        return due

    def _known(self, now_s: float, name: str) -> bool:
        """Whether there is no need to ask: what was answered, for as long as that lasts."""
        if (
            (name == PARAMETER and self.parameters_read)
            or (name == VERSION and self.version_known)
            or (name == SET_ORIGIN and self.origin_set(now_s))
        ):
            return True
        if name == HEARTBEAT:
            return False  # also before anything is heard: on some links it must speak first
        if not self.connected(now_s) or (self._booting and name in _ONCE_STARTED):
            return True
        return name == STREAMS and not self._stopped(now_s)
