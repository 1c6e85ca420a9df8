# SPDX-License-Identifier: Apache-2.0
"""The process that calibrates the column and sets home, without its transport."""

import logging
from dataclasses import dataclass
from typing import Dict, List, Mapping, Optional, Sequence, Set

import numpy as np

from fcsv_geometry.errors import FcsvError, PoseUnavailable
from fcsv_geometry.home import home_of
from fcsv_geometry.missions.phases import BY_HOME
from fcsv_geometry.streams.dispatch import Takers
from fcsv_geometry.trajectory import Trajectory
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_tracking.column.agreement import ColumnDrift
from fcsv_tracking.column.calibration import CalibrationRules, Link
from fcsv_tracking.column.calibration_session import CalibrationSession
from fcsv_tracking.devices.clocks import ClockOffset, VehicleClock
from fcsv_tracking.errors import CalibrationRefused, ClocksApart, TrackerDrifts, TrackingError

_log = logging.getLogger(__name__)
_OLDEST_ODOMETRY_S = 0.5
_SET_BACK_S = 0.3
_STATIONS = "CONFIGURATIONS"  # phase in which vehicles stand at stations


@dataclass(frozen=True)
class CalibrateColumn:
    """Calibrate these vehicles, front first (none: all), for ``duration_s`` (0: as long as it
    takes). ``in_flight``: the mission flies them, and has stopped for it; the result is taken over
    where it agrees with what the trackers said."""

    column: Sequence[str]
    duration_s: float = 0.0
    in_flight: bool = False


@dataclass(frozen=True)
class HomeWanted:
    """Home is to be where the camera of ``reference`` (empty: the first) is now."""

    reference: str


class CalibrationPort:
    """``vehicles`` in the order of the column. It listens always, and collects while a calibration
    runs.

    Gives CalibrationFound or HomeFound, each with its EpochsFound and a Reply, and Dropped.
    """

    def __init__(self, vehicles: Mapping[str, VehicleGeometry], rules: CalibrationRules):
        self._vehicles, self._rules = vehicles, rules
        self._tracks: Dict[str, Trajectory] = {n: _new_track() for n in vehicles}
        self._came_s: Dict[str, float] = {}  # the newest odometry
        self._clocks: Dict[str, ClockOffset] = {}
        self._epochs: Dict[str, int] = {}  # a vehicle that tells none has none
        self._phase = ""  # the mission's
        self._session: Optional[CalibrationSession] = None
        self._epochs_begun: Dict[str, int] = {}  # as the session began
        self._in_flight = False  # the session is
        self._drift = ColumnDrift(list(vehicles), rules.tracker)
        self._epochs_calibrated: Dict[str, int] = {}
        self._calibrated: Set[str] = set()
        self._dropped: List[tm.Dropped] = []
        self._take = Takers(
            {
                tm.VehicleOdometry: self._odometry,
                tm.SeenTags: self._tags,
                tm.OdometryEpoch: self._epoch,
                tm.MissionPhase: self._mission,
                VehicleClock: self._clock,
            },
            "the calibration does not hear",
        )

    @property
    def collects(self) -> bool:
        """Whether a calibration runs."""
        return self._session is not None

    # ---- what is heard ---------------------------------------------------------------------------

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known here."""
        self._take[type(message)](now_s, message)

    def _odometry(self, now_s: float, m: tm.VehicleOdometry) -> None:
        if self._track(m.vehicle, m.stamp_s).add(m.stamp_s, m.T_odom_body):
            self._came_s[m.vehicle] = now_s
            if self._drift.begun:
                self._drift.odometry(m.vehicle, m.stamp_s, m.T_odom_body)
        else:
            self._drop("odometry", f"{m.vehicle}'s stamp goes back")

    def _track(self, name: str, stamp_s: float) -> Trajectory:
        """A vehicle's track; a new one where its clock was set back."""
        track = self._tracks[name]
        if len(track) and stamp_s < track.latest()[0] - _SET_BACK_S:
            track = self._tracks[name] = _new_track()
        return track

    def _tags(self, now_s: float, m: tm.SeenTags) -> None:
        if self._session is not None:
            self._session.tags(now_s, m)

    def _epoch(self, _now_s: float, m: tm.OdometryEpoch) -> None:
        self._epochs[m.vehicle] = m.number

    def _mission(self, _now_s: float, m: tm.MissionPhase) -> None:
        self._phase = m.phase

    def _clock(self, _now_s: float, m: VehicleClock) -> None:
        self._clocks[m.vehicle] = m.offset

    def _drop(self, what: str, why: str) -> None:
        self._dropped.append(tm.Dropped(what, why))

    # ---- what is asked for -----------------------------------------------------------------------

    def serve(self, now_s: float, request: object) -> List[object]:
        """HomeWanted is answered at once; CalibrateColumn too where it is refused, else by a later
        ``step``. Raises TypeError for anything else."""
        if not isinstance(request, (CalibrateColumn, HomeWanted)):
            raise TypeError(f"the calibration does not serve {type(request).__name__}")
        try:
            return (
                self._set_home(now_s, request)
                if isinstance(request, HomeWanted)
                else self._begin(now_s, request)
            )
        except FcsvError as error:
            return [tm.Reply(False, str(error))]

    def _begin(self, now_s: float, request: CalibrateColumn) -> List[object]:
        self._require_may_be_calibrated(request.in_flight)
        if self._session is not None:
            raise TrackingError("a calibration is already running")
        column = list(request.column) or list(self._vehicles)
        session = CalibrationSession(
            now_s, column, request.duration_s, self._vehicles, self._rules, self._drop
        )
        self._session, self._epochs_begun = session, self._epochs_of(column)
        self._in_flight = request.in_flight
        return []

    def step(self, now_s: float) -> List[object]:
        """The end of a calibration that has collected enough."""
        out: List[object] = []
        if self._session is not None and self._session.enough(now_s):
            session, self._session = self._session, None
            try:
                out = self._end(session)
            except FcsvError as error:
                _log.warning("calibration refused: %s", error)
                kinds = (isinstance(error, kind) for kind in (ClocksApart, TrackerDrifts))
                out = [tm.Reply(False, str(error), *kinds)]
        dropped, self._dropped = self._dropped, []
        return [*dropped, *out]

    def _end(self, session: CalibrationSession) -> List[object]:
        found, epochs = session.found(self._tracks, self._clocks), self._epochs_begun
        anew = [n for n in epochs if self._epochs[n] != epochs[n]]
        if anew:
            raise CalibrationRefused(
                f"the odometry of {', '.join(anew)} began anew meanwhile: calibrate once more"
            )
        self._require_may_be_calibrated(self._in_flight)
        text = "; ".join(_in_words(link) for link in found.links)
        if self._in_flight:
            text = f"{self._require_agreement(found, epochs)}; {text}"
        self._calibrated, self._epochs_calibrated = set(session.column), epochs
        self._drift.calibrate(found.stamp_s, found.links)
        _log.info("calibrated: %s", text)
        return [found, tm.EpochsFound(tm.CALIBRATION, found.stamp_s, epochs), tm.Reply(True, text)]

    def _require_may_be_calibrated(self, in_flight: bool) -> None:
        if not in_flight:
            self._require_nobody_flies_by_it("a calibration")
        elif self._phase != _STATIONS:
            raise TrackingError(f"a calibration in flight is for stations; this is {self._phase}")

    def _require_agreement(self, found: tm.CalibrationFound, epochs: Mapping[str, int]) -> str:
        """Says by how much a calibration in flight differs from what the trackers said, in words. Raises
        TrackerDrifts where that is beyond what is known of them, CalibrationRefused where there is
        nothing to compare it with."""
        differences = self._drift.differences(found.links)
        if len(differences) < len(found.links) or epochs != self._epochs_calibrated:
            raise CalibrationRefused("the calibration before is not known here: land, calibrate")
        off = [d for d in differences if d.drifted]
        if off:
            raise TrackerDrifts(f"{'; '.join(map(str, off))}: a tracker drifts")
        return "; ".join(map(str, differences))

    def _set_home(self, now_s: float, request: HomeWanted) -> List[object]:
        reference = request.reference or next(iter(self._vehicles))
        self._require_nobody_flies_by_it("a new home")
        if reference not in self._vehicles:
            raise TrackingError(
                f"'{reference}' is not a vehicle here; known: {', '.join(self._vehicles)}"
            )
        if reference not in self._calibrated:
            raise TrackingError(f"{reference} is not calibrated yet: calibrate the column first")
        stamp_s, T_odom_body = self._tracks[reference].latest()
        age_s = now_s - self._came_s[reference]
        if age_s > _OLDEST_ODOMETRY_S:
            raise PoseUnavailable(
                f"the odometry of {reference} is {age_s:.1f} s old: check its link, then set home again"
            )
        home = tm.HomeFound(
            stamp_s, reference, home_of(T_odom_body @ self._vehicles[reference].T_body_cam)
        )
        text = f"home is where the camera of {reference} is now"
        _log.info("%s", text)
        return [
            home,
            tm.EpochsFound(tm.HOME, stamp_s, self._epochs_of([reference])),
            tm.Reply(True, text),
        ]

    def _require_nobody_flies_by_it(self, what: str) -> None:
        """Raises TrackingError from GUIDED on: another calibration or home would move every place
        that is flown to."""
        if self._phase in BY_HOME:
            raise TrackingError(
                f"{what} is refused while the mission flies the vehicles ({self._phase}): land first"
            )

    def _epochs_of(self, names: Sequence[str]) -> Dict[str, int]:
        return {n: self._epochs[n] for n in names if n in self._epochs}


def _new_track() -> Trajectory:
    return Trajectory(gap_s=0.15, keep_s=60.0)


def _in_words(link: Link) -> str:
    yaw_std_deg = np.degrees(np.sqrt(link.covariance[3, 3]))
    return (
        f"{link.child} against {link.parent}: {link.used} detections ({link.rejected} rejected), "
        f"spread {link.position_spread_m * 100:.1f} cm, yaw std {yaw_std_deg:.2f} deg"
    )
