# SPDX-License-Identifier: Apache-2.0
"""How quick the operator's window is beside a map that grows: part of bench_console.py (--live
SESSION)."""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import List, Optional

CAPTURES_HZ, PREVIEWS_HZ = 2.0, 1.0  # as vehicles send them (fcsv_tracking/ros/picture_sender.py)
_BEFORE_S = 20.0  # the live map loads its kernels, everybody finds each other

LISTENER = """
import sys, time, rospy
from std_msgs.msg import String
from fcsv_geometry.ros import node
node.begin("listener", anonymous=True)
rospy.Subscriber("/stop_all", String, lambda m: print(time.monotonic(), flush=True), tcp_nodelay=True)
rospy.spin()
"""


def sent_pictures(session: Path, out: Path) -> List[str]:
    """A bag of what a session's vehicles sent for the live map and the window, which nobody
    records; the vehicles."""
    import cv2
    import rosbag
    import rospy
    from sensor_msgs.msg import CompressedImage

    from fcsv_geometry import transforms
    from fcsv_geometry.home import HomeFrames
    from fcsv_geometry.ros import conversions
    from fcsv_geometry.streams.flow import RateGate
    from fcsv_geometry.vehicles import home_messages
    from fcsv_msgs.msg import CapturedPicture
    from fcsv_stereo.sessions.read import read_session

    in_home = HomeFrames()
    with rosbag.Bag(str(session / "control.bag")) as bag:
        for topic, message, _ in bag.read_messages(topics=["/calibration", "/home"]):
            (
                home_messages.take_calibration
                if topic == "/calibration"
                else home_messages.take_home
            )(in_home, message)
    pictures = {}
    for c in read_session(session).configurations:
        pictures.update({(p.vehicle, p.stamp_s): p for p in (*c.references, *c.others)})
    gates = {}
    with rosbag.Bag(str(out), "w") as bag:
        for (vehicle, stamp_s), p in sorted(pictures.items(), key=lambda found: found[0][1]):
            _, jpeg = cv2.imencode(
                ".jpg", cv2.cvtColor(p.image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 95]
            )
            header = conversions.header(stamp_s, f"{vehicle}/camera_optical")
            info = conversions.info_from_camera(p.camera, stamp_s, header.frame_id)
            T_odom_cam = transforms.invert(in_home.T_home_odom[vehicle]) @ p.T_home_cam
            sent = {
                (CAPTURES_HZ, "capture/picture"): CapturedPicture(
                    header=header,
                    vehicle=vehicle,
                    camera=info,
                    format="jpeg",
                    data=jpeg.tobytes(),
                    camera_in_odom=conversions.transform_to_pose(T_odom_cam),
                ),
                (PREVIEWS_HZ, "camera/color/image_raw/compressed"): CompressedImage(
                    header=header, format="jpeg", data=jpeg.tobytes()
                ),
            }
            for (rate_hz, topic), message in sent.items():
                if gates.setdefault((vehicle, topic), RateGate(rate_hz)).passes(stamp_s):
                    bag.write(f"/{vehicle}/{topic}", message, rospy.Time.from_sec(stamp_s + 0.2))
    return sorted({vehicle for vehicle, _ in pictures})


def beside_a_live_map(session: Path, seconds: float, number: int, picture: Optional[Path]) -> int:
    """Prints refreshes a second, the longest wait for one, and from click to topic, while the
    session is mapped."""
    from fcsv_console.ros.shell import open_shell
    from fcsv_console.ros.window_command import application, connected
    from fcsv_sim.machines.machines import Machine

    embeds = bool(os.environ.get("DISPLAY"))
    os.environ.setdefault("QT_QPA_PLATFORM", "xcb" if embeds else "offscreen")
    with tempfile.TemporaryDirectory() as folder, Machine("bench", folder) as machine:
        os.environ.update({k: v for k, v in machine.env.items() if k.startswith("ROS_")})
        vehicles = sent_pictures(session, Path(folder) / "sent.bag")
        machine.run(["rosrun", "fcsv_stereo", "live_map", f"_vehicles:={vehicles}"], "live_map")
        bags = [str(session / "control.bag"), str(Path(folder) / "sent.bag")]
        machine.run(["rosbag", "play", "--quiet", "--loop", *bags], "play")
        listener = subprocess.Popen(
            [sys.executable, "-c", LISTENER], stdout=subprocess.PIPE, text=True, env=os.environ
        )
        try:
            app = application("dark")
            shell = open_shell("bench_console", vehicles, "", 0.0, windowed=True)
            window = connected(shell, app)
            window.show()
            window.show_pictures.click()
            measured = Measured(app, window, shell)
            measured.go_on(_BEFORE_S)
            if embeds:
                window.show_rviz.click()
                measured.go_on(3.0)
            measured.begin()
            measured.go_on(seconds)
            measured.click(number, listener)
            print(measured.words(embeds))
            if picture:
                app.primaryScreen().grabWindow(0).save(str(picture))
            shell.close()
        finally:
            listener.kill()
    sys.stdout.flush()
    os._exit(0)  # as the window's own command ends: threads of rospy and rviz still run


class Measured:
    """A window that is looked at while its event loop runs."""

    def __init__(self, app, window, shell):
        self._app, self._window, self._shell = app, window, shell
        self._shown_s: List[float] = []
        self._clicks_ms: List[float] = []
        self._maps: List[float] = []
        show = window.show_view

        def shown(view) -> None:
            self._shown_s.append(time.monotonic())
            show(view)

        window.show_view = shown

    def _on_map(self, message) -> None:
        if message.state in ("partial", "ready") and message.processing_s not in self._maps[-1:]:
            self._maps.append(message.processing_s)

    def begin(self) -> None:
        """What came before does not count. The window's shell is a node by now."""
        import rospy

        from fcsv_msgs.msg import MapState

        rospy.Subscriber("/map/state", MapState, self._on_map)
        self._begun_s, self._shown_s[:], self._maps[:] = time.monotonic(), [], []
        self._load = os.getloadavg()[0]

    def go_on(self, seconds: float) -> None:
        """With the event loop, as it runs."""
        from python_qt_binding.QtCore import QTimer

        QTimer.singleShot(int(1e3 * seconds), self._app.quit)
        self._app.exec_()

    def click(self, number: int, listener) -> None:
        """A held button that is let go of, until another process hears it, ten times a second and
        between refreshes."""
        for k in range(number):
            self.go_on(0.1 + 0.007 * (k % 11))
            begun_s = time.monotonic()
            self._window.buttons["stop_all"].asked.emit("stop_all")
            self._clicks_ms.append(1e3 * (float(listener.stdout.readline()) - begun_s))

    def words(self, embeds: bool) -> str:
        """The figures, a line each."""
        gaps_ms = sorted(1e3 * (b - a) for a, b in zip(self._shown_s, self._shown_s[1:]))
        rate_hz = 1e3 / statistics.mean(gaps_ms)
        late = sum(gap > 200.0 for gap in gaps_ms)
        clicks = sorted(self._clicks_ms)
        took_s = time.monotonic() - self._begun_s
        lines = [
            f"beside a live map ({len(self._maps)} maps, {sum(self._maps):.0f} s of {took_s:.0f}), pictures open, "
            f"rviz {'embedded' if embeds else 'not opened'}, load {self._load:.1f}",
            f"refreshes: {rate_hz:.1f} a second, 99 % within {gaps_ms[int(0.99 * len(gaps_ms))]:.0f} ms, "
            f"the longest after {gaps_ms[-1]:.0f} ms, {late} of {len(gaps_ms)} later than 200 ms",
        ]
        if clicks:
            lines.append(
                f"click to topic: median {statistics.median(clicks):.1f} ms, longest {clicks[-1]:.1f} ms of "
                f"{len(clicks)}"
            )
        return "\n".join(lines)
