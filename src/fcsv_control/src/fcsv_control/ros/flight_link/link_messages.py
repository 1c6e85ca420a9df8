# SPDX-License-Identifier: Apache-2.0
"""What a flight link's port gives, as topics and diagnostics, and what it hears: of our own link,
and beside MAVROS."""

from typing import Any, Callable, Dict

import rospy
from geometry_msgs.msg import PoseStamped, Vector3Stamped
from std_srvs.srv import Trigger, TriggerResponse

from fcsv_control.flight import messages
from fcsv_control.flight.link import FlightLink
from fcsv_control.flight.messages import EstimateMoved, LinkLives, ParametersChecked, PosePassed
from fcsv_control.ros.flight_link.posed import pose_in
from fcsv_geometry import frames
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_msgs.msg import LinkHealth, ModeAsked, ParameterReport, SceneMotion

_PREARM = {
    None: LinkHealth.PREARM_UNKNOWN,
    True: LinkHealth.PREARM_READY,
    False: LinkHealth.PREARM_NOT_READY,
}


class LinkMessages:
    """``publish`` gives out what a port gave, where it knows its type; ``subscribe`` makes a link hear
    the odometry."""

    def __init__(self, name: str, health: Health):
        self._odom, self._health = frames.odom(name), health
        self._lives = rospy.Publisher("flight_link/health", LinkHealth, queue_size=5)
        self._moved = rospy.Publisher("flight_link/estimate_moved", Vector3Stamped, queue_size=20)
        self._parameters = rospy.Publisher(
            "flight_link/parameters", ParameterReport, queue_size=2, latch=True
        )
        self._asks = rospy.Publisher(
            "flight_link/mode_asked", ModeAsked, queue_size=10, tcp_nodelay=True
        )
        self._publish: Dict[type, Callable[[Any], None]] = {
            tm.Diagnosis: health.diagnose,
            EstimateMoved: self._estimate_moved,
            LinkLives: self._live,
            ParametersChecked: self._parameters_checked,
            PosePassed: lambda _m: health.tick("pose feed"),
            messages.ModeAsked: lambda m: self._asks.publish(ModeAsked(header(), m.mode)),
            tm.Dropped: lambda m: health.drop(m.what, m.why),
        }

    def publish(self, output: object) -> bool:
        """Whether its type is one of those that are published here."""
        publish = self._publish.get(type(output))
        if publish is not None:
            publish(output)
        return publish is not None

    def subscribe(self, link: FlightLink) -> None:
        """The odometry's poses, what pictures say of them, and the word that their frame was begun
        anew."""

        def fed(message: PoseStamped) -> None:
            T_odom_body = pose_in(self._odom, message, "pose feed", self._health)
            if T_odom_body is not None:
                link.receive(messages.PoseFed(T_odom_body, message.header.stamp.to_sec()))

        def reset(_request) -> TriggerResponse:
            link.receive(messages.OdometryReset())
            return TriggerResponse(
                True, "the next pose is adopted at once; the set-point has to be issued again"
            )

        def looked(m: SceneMotion) -> None:
            link.receive(tm.SceneLook(m.span_s, m.off_rad, m.turn_rad, m.points, m.one_way))

        rospy.Service("~odometry_reset", Trigger, reset)
        rospy.Subscriber(
            "mavros/vision_pose/pose", PoseStamped, fed, queue_size=1, tcp_nodelay=True
        )
        rospy.Subscriber("tags/scene_motion", SceneMotion, looked, queue_size=1)

    def _live(self, m: LinkLives) -> None:
        told = {**vars(m), "in_the_air": -1 if m.in_the_air is None else int(m.in_the_air)}
        prearm = _PREARM[told.pop("prearm_ok")]
        self._lives.publish(LinkHealth(header=header(), prearm=prearm, **told))

    def _parameters_checked(self, m: ParametersChecked) -> None:
        told = {
            **vars(m),
            "limits": list(m.limits.values),
            "limit_values": list(m.limits.values.values()),
        }
        self._parameters.publish(ParameterReport(header=header(), **told))

    def _estimate_moved(self, m: EstimateMoved) -> None:
        message = Vector3Stamped(header=conversions.header(rospy.get_time(), self._odom))
        message.vector.x, message.vector.y, message.vector.z = map(float, m.step_m)
        self._moved.publish(message)


def header():
    """Makes the header of a message in no frame."""
    return conversions.header(rospy.get_time(), "")
