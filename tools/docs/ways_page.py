# SPDX-License-Identifier: Apache-2.0
"""The page of the ways that things take through the code, file by file; what each file is for is its
own docstring's first sentence."""

import importlib
import inspect
from pathlib import Path
from typing import Sequence, Tuple, Union

#: a part of the code (module:name), or words on what lies between two parts
Step = Union[str, Tuple[str]]

_SAMPLE: Sequence[Step] = (
    ("the T265's driver (`launch/trackers/t265.launch`): topic `t265/odom/sample`, 200 Hz",),
    "fcsv_tracking.ros.odometry_node:OdometryNode",
    "fcsv_tracking.odometry_port:OdometryPort",
    "fcsv_tracking.odometry:BodyOdometry",
    ("topic `mavros/vision_pose/pose`, 30 Hz",),
    "fcsv_control.ros.flight_link.flight_link_node:FlightLinkNode",
    "fcsv_control.flight.link:FlightLink",
    "fcsv_control.flight.port:FlightLinkPort",
    "fcsv_control.flight.pose_feed.feed:PoseGate",
    "fcsv_control.flight.pose_feed.feed_check:PoseCheck",
    "fcsv_control.flight.pose_feed.height_check:HeightCheck",
    "fcsv_control.flight.pose_feed.scene_check:SceneCheck",
    "fcsv_control.flight.pose_feed.watchdog:PoseWatchdog",
    "fcsv_control.flight.core:LinkCore",
    "fcsv_control.flight.mavlink.conversion:ned_from_pose",
    "fcsv_control.flight.mavlink.transport:Transport",
    "fcsv_control.flight.mavlink.lines:SerialLine",
    ("MAVLink `VISION_POSITION_ESTIMATE` to the autopilot",),
)
_PAUSE: Sequence[Step] = (
    "fcsv_console.qt.window:ConsoleWindow",
    "fcsv_console.model.actions:actions",
    "fcsv_console.ros.shell:ConsoleShell",
    "fcsv_console.ros.commands:CommandClient",
    ("service `/mission/control` on the control PC",),
    "fcsv_control.ros.mission.mission_desk:MissionDesk",
    "fcsv_control.ros.mission.mission_node:MissionNode",
    "fcsv_control.mission.port:MissionPort",
    "fcsv_control.mission.operator_commands:OperatorCommands",
    "fcsv_control.mission.machine:MissionMachine",
    "fcsv_control.mission.activities.flight_list:FlightList",
    "fcsv_control.mission.activities.moving:Hold",
    "fcsv_control.mission.activities.holding:Holding",
    "fcsv_control.mission.outbox:Outbox",
    "fcsv_control.ros.mission.vehicle_messages:command_of",
    ("topic `/uavN/command`, `HOLD`, numbered, repeated until it is acknowledged",),
    "fcsv_multimaster.ros.relay_node:RelayNode",
    "fcsv_multimaster.relay.exchange:Exchange",
    "fcsv_multimaster.network.transport:ZenohTransport",
    "fcsv_multimaster.relay.order:DeliveryOrder",
    "fcsv_multimaster.ros.inbox:Inbox",
    ("the same topic on the vehicle's own master",),
    "fcsv_control.ros.agent_node:AgentNode",
    "fcsv_control.agent.port:AgentPort",
    "fcsv_control.agent.core:AgentCore",
    "fcsv_control.agent.rights:Rights",
    "fcsv_control.agent.holder:Holder",
    ("topic `mavros/setpoint_position/local`: the place where it was, again and again",),
    "fcsv_control.ros.flight_link.flight_link_node:FlightLinkNode",
    "fcsv_control.flight.port:FlightLinkPort",
    "fcsv_control.flight.core:LinkCore",
    ("MAVLink `SET_POSITION_TARGET_LOCAL_NED`; the vehicle holds in GUIDED",),
    ("back: topic `/uavN/command_ack` to the mission, `/mission/state` to the window",),
    "fcsv_control.mission.outbox:Outbox",
    "fcsv_console.model.console:Console",
)
_PICTURE: Sequence[Step] = (
    ("the camera's driver (`launch/cameras/`): topics `camera/color/image_raw`, `camera_info`",),
    "fcsv_control.ros.recording.recorder_node:RecorderNode",
    "fcsv_control.ros.recording.bag_writer:BagWriter",
    ("the vehicle's bag; on landing `gather_session`",),
    "fcsv_control.gathering:Gatherer",
    ("a session folder; `rosrun fcsv_stereo map SESSION -o OUT`",),
    "fcsv_stereo.cli:main",
    "fcsv_stereo.pipeline:run",
    "fcsv_stereo.sessions.read:read_session",
    "fcsv_stereo.sessions.recorded:read_recorded",
    "fcsv_stereo.sessions.tracks:track_of",
    "fcsv_stereo.sessions.pictures:read_pictures",
    "fcsv_stereo.joint.method:Joint",
    "fcsv_stereo.refinement.refine:refine",
    "fcsv_stereo.refinement.tracks:observe",
    "fcsv_stereo.refinement.adjustment:adjusted",
    "fcsv_stereo.joint.match:match_jointly",
    "fcsv_stereo.joint.volume.winner:match_volume",
    "fcsv_stereo.joint.surfaces.select:choose_surfaces",
    "fcsv_stereo.joint.refine.subpixel:refine",
    "fcsv_stereo.joint.checks.sigma:matching_sigma",
    "fcsv_stereo.joint.checks.kinds:kinds",
    "fcsv_stereo.depth:cloud_of",
    "fcsv_stereo.map_files.output:write_arrays",
    "fcsv_stereo.report.page:write_report",
)
_WAYS = (
    ("A sample of the tracking camera to the autopilot", _SAMPLE),
    ("The operator's Pause to a vehicle that holds", _PAUSE),
    ("A picture to the map", _PICTURE),
)
_INTRODUCTION = (
    "Three ways through the code, in their order. In the rehearsal the same ports stand between the same cores; "
    "its bus takes the place of topics, relay and threads."
)


def page(head: str, root: Path) -> str:
    """Markdown. Raises ImportError or AttributeError where a part is not there any more."""
    lines = [head, "# Ways through the code", "", _INTRODUCTION, ""]
    for title, steps in _WAYS:
        lines += [
            f"## {title}",
            "",
            "| | file | part | what the file is for |",
            "|---|---|---|---|",
        ]
        lines += [_row(i, step, root) for i, step in enumerate(steps, 1)]
        lines.append("")
    return "\n".join(lines)


def _row(number: int, step: Step, root: Path) -> str:
    if isinstance(step, tuple):
        return f"| {number} | | | *{step[0]}* |"
    module_name, name = step.split(":")
    module = importlib.import_module(module_name)
    getattr(module, name)
    file = Path(inspect.getfile(module)).resolve().relative_to(root)
    return f"| {number} | [{_short(file)}](../../{file}) | `{name}` | {_first_sentence(module)} |"


def _short(file: Path) -> str:
    """``fcsv_control/flight/core.py`` of ``src/fcsv_control/src/fcsv_control/flight/core.py``."""
    return str(Path(*file.parts[3:]))


def _first_sentence(module: object) -> str:
    text = " ".join((inspect.getdoc(module) or "").split())
    end = text.find(". ")
    return (text if end < 0 else text[: end + 1]).replace("|", "\\|")
