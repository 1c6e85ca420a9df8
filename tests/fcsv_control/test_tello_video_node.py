# SPDX-License-Identifier: Apache-2.0
"""The node tello_link publishes the simulated Tello's H.264 as pictures, stamped with when they
were taken."""

import numpy as np
import pytest
from support.tello_air import until
from support.tello_loop import CONFIG

from fcsv_geometry.camera_file import write_camera
from fcsv_sim.sensors.camera import CameraParameters
from fcsv_sim.tello.pictures import SimulatedVideoParameters
from fcsv_sim.tello.radio import WifiParameters

pytestmark = [pytest.mark.ros, pytest.mark.slow]
SMALL = CameraParameters(width=480, height=360, horizontal_fov_deg=70.1)
DELAY_S = 0.5  # long enough for a picture to be rendered on a busy machine
PICTURES = 6


@pytest.mark.alone  # how late stamps are is measured
def test_pictures_come_with_their_calibration_and_the_time_of_their_exposure(
    start_node, tello_air, tmp_path, root
):
    """One picture a second; the radio takes some 10 ms, so a stamp is within 0.1 s of its own
    picture's exposure."""
    import rospy
    from sensor_msgs.msg import CameraInfo, Image

    name, network = "tello1", tello_air.network()
    shows = SimulatedVideoParameters(
        "street",
        vehicles_dir=str(root / "config/vehicles"),
        rate_hz=1.0,
        delay_s=DELAY_S,
        camera=SMALL,
    )
    tello_air.drone(network, vehicle=name, radio=WifiParameters(loss=0.0), video=shows)
    write_camera(tmp_path / "camera.yaml", name, SMALL.model)
    pictures, infos = [], []
    heard = [
        rospy.Subscriber(f"/{name}/camera/color/image_raw", Image, pictures.append),
        rospy.Subscriber(f"/{name}/camera/color/camera_info", CameraInfo, infos.append),
    ]
    params = {
        "vehicle": name,
        "gains": str(CONFIG / "velocity.yaml"),
        "radio": {"network": f"{network}-pilot"},
        "video": {"calibration": str(tmp_path / "camera.yaml"), "delay_s": DELAY_S},
    }
    start_node("fcsv_control", "tello_link", name="flight_link", ns=name, params=params)
    try:
        until(lambda: len(pictures) >= PICTURES and len(infos) >= PICTURES, 120.0, "pictures")
    finally:
        for each in heard:
            each.unregister()
    assert (pictures[0].width, pictures[0].height, pictures[0].encoding) == (480, 360, "rgb8")
    assert infos[0].K[0] == pytest.approx(SMALL.model.fx) and infos[0].header == pictures[0].header
    assert pictures[0].header.frame_id == f"{name}/camera_optical"
    assert np.std(np.frombuffer(pictures[-1].data, np.uint8)) > 10  # not one colour
    rows = (tmp_path / f"truth_cameras_{name}.csv").read_text().splitlines()[1:]
    taken_s = np.array([float(row.split(",")[0]) for row in rows])
    off_s = [np.abs(taken_s - p.header.stamp.to_sec()).min() for p in pictures]
    print(f"stamps off by {np.median(off_s):.3f} s (median)")
    assert np.median(off_s) < 0.1
