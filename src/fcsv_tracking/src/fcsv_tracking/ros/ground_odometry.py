# SPDX-License-Identifier: Apache-2.0
"""A tracker on the ground, as mission, agent, guardian and recorder know trackers on board.

Of each vehicle: odometry/body, odometry/state, odometry/epoch and mavros/vision_pose/pose in
``NAME/odom``, which is one level frame for all; /calibration says so, /calibration_epochs for which
beginning of it.
"""

import threading
from typing import Dict, Optional, Sequence

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped, TransformStamped, Twist, Vector3
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.missions.phases import BY_HOME
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.telemetry_messages import epochs_message
from fcsv_geometry.vehicles.telemetry import CALIBRATION, HOME, EpochsFound
from fcsv_msgs.msg import Calibration, CalibrationLink, Epoch, Epochs, MissionState
from fcsv_msgs.srv import Calibrate, CalibrateResponse
from fcsv_tracking.errors import TrackingError
from fcsv_tracking.ground import GroundTrack, LevelFrame, LevelRules

_EPOCH_PARAM = "/ground_tracker_epoch"
_ONE_FRAME = np.eye(4) * 1e-8  # m2, rad2: the same frame


class GroundOdometryPublisher:
    """``level`` and ``pose`` as the tracker has them, from any thread. ``tracker_frame``: its own
    frame on tf2."""

    def __init__(
        self, names: Sequence[str], tracker_frame: str, rules: Optional[LevelRules] = None
    ):
        self._names, self._tracker_frame, self._lock = list(names), tracker_frame, threading.Lock()
        self._frame, self._phase, self.epoch = LevelFrame(rules), "", 0
        self._tracks: Dict[str, GroundTrack] = {n: GroundTrack() for n in names}
        publisher = lambda n, topic, kind, **k: rospy.Publisher(  # noqa: E731
            f"/{n}/{topic}", kind, queue_size=10, **k
        )
        odometry = ("odometry/body", "odometry/state")
        self._odometry = {
            n: [publisher(n, t, Odometry, tcp_nodelay=True) for t in odometry] for n in names
        }
        self._feed = {
            n: publisher(n, "mavros/vision_pose/pose", PoseStamped, tcp_nodelay=True) for n in names
        }
        self._epochs = {n: publisher(n, "odometry/epoch", Epoch, latch=True) for n in names}
        self._calibration = rospy.Publisher("/calibration", Calibration, queue_size=1, latch=True)
        self._holds_for = {
            w: rospy.Publisher(f"/{w}_epochs", Epochs, queue_size=1, latch=True)
            for w in ("calibration", "home")
        }
        rospy.Service("/calibrate", Calibrate, self._on_calibrate)
        rospy.Subscriber("/mission/state", MissionState, self._on_mission, queue_size=1)

    @property
    def T_tracker_level(self) -> Optional[np.ndarray]:
        """None as long as the tracker does not know what is level."""
        return self._frame.T_tracker_level

    def level(self, R_tracker_level: np.ndarray, sigma_rad: float) -> None:
        """What the tracker holds for level now."""
        with self._lock:
            if not self._frame.offer(R_tracker_level, sigma_rad):
                return
            for track in self._tracks.values():
                track.begin_again()
            self.epoch = max(
                int(rospy.get_param(_EPOCH_PARAM, 0)) + 1, int(rospy.get_time()) % 2**31
            )
            rospy.set_param(_EPOCH_PARAM, self.epoch)
        rospy.logwarn(
            "%s: epoch %d of its level frame: %s", self._tracker_frame, self.epoch, self._frame.why
        )
        for publisher in self._epochs.values():
            publisher.publish(
                Epoch(conversions.header(rospy.get_time(), ""), self.epoch, self._frame.why)
            )

    def pose(
        self, name: str, stamp_s: float, T_tracker_body: np.ndarray, covariance: np.ndarray
    ) -> Sequence[TransformStamped]:
        """A new pose of a vehicle goes out; its transforms, none before the frame is known."""
        with self._lock:
            T_tracker_level = self.T_tracker_level
            if T_tracker_level is None:
                return []
            found = self._tracks[name].add(stamp_s, T_tracker_body, covariance, T_tracker_level)
        if found is None:
            return []
        odom, body = frames.odom(name), frames.base_link(name)
        message = Odometry(header=conversions.header(stamp_s, odom), child_frame_id=body)
        message.pose.pose = conversions.transform_to_pose(found.T_odom_body)
        message.pose.covariance = found.covariance.ravel().tolist()
        message.twist.twist = Twist(Vector3(*found.v_body_mps), Vector3())
        for publisher in self._odometry[name]:
            publisher.publish(message)
        self._feed[name].publish(PoseStamped(message.header, message.pose.pose))
        return [
            conversions.transform_stamped(T_tracker_level, stamp_s, self._tracker_frame, odom),
            conversions.transform_stamped(found.T_odom_body, stamp_s, odom, body),
        ]

    def require_nobody_flies_by_it(self, what: str) -> None:
        """Raises TrackingError where another home or calibration would move every place that is
        flown to."""
        if self._phase in BY_HOME:
            raise TrackingError(
                f"{what} is refused while the mission flies the vehicles ({self._phase}): land first"
            )

    def require_level(self) -> np.ndarray:
        """T_tracker_level. Raises TrackingError."""
        if self.T_tracker_level is None:
            raise TrackingError(
                "the tracker on the ground does not know what is level yet: fly one into its view"
            )
        return self.T_tracker_level

    def home_set(self) -> None:
        """Says for which epochs home holds."""
        epochs = dict.fromkeys(self._names, self.epoch)
        self._holds_for["home"].publish(epochs_message(EpochsFound(HOME, rospy.get_time(), epochs)))

    def _on_mission(self, message: MissionState) -> None:
        self._phase = message.phase_name

    def _on_calibrate(self, request) -> CalibrateResponse:
        column = list(request.column) or self._names
        try:
            self.require_nobody_flies_by_it("a calibration")
            self.require_level()
            unknown = [n for n in column if n not in self._names]
            if unknown or len(column) < 2:
                raise TrackingError(
                    f"a column needs two known vehicles or more, front first; got {column}"
                )
        except TrackingError as error:
            return CalibrateResponse(False, str(error), Calibration())
        message = Calibration(header=conversions.header(rospy.get_time(), frames.odom(column[0])))
        here = conversions.transform_to_pose(np.eye(4))
        message.links = [
            CalibrationLink(
                parent=a,
                child=b,
                child_odom_in_parent_odom=here,
                covariance=_ONE_FRAME.ravel().tolist(),
            )
            for a, b in zip(column, column[1:])
        ]
        self._calibration.publish(message)
        epochs = dict.fromkeys(column, self.epoch)
        held = EpochsFound(CALIBRATION, message.header.stamp.to_sec(), epochs)
        self._holds_for["calibration"].publish(epochs_message(held))
        return CalibrateResponse(
            True, "the tracker on the ground gives all vehicles in one frame", message
        )
