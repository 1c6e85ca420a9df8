# SPDX-License-Identifier: Apache-2.0
"""Unmodified tellopy flies the simulated Tello over its own protocol, in real time."""

import subprocess
import sys
import time

import numpy as np
import pytest
from support.tello_air import free_udp_port, until

from fcsv_geometry.programs import netns
from fcsv_sim.tello.drone import DroneParameters
from fcsv_sim.tello.radio import WifiParameters
from fcsv_sim.truth import TruthReader

G_MPS2 = 9.81


def takes_off(client, drone):
    """What a pilot does when nothing happens: a command is not repeated by tellopy, and the air
    loses 1 %."""
    until(
        lambda: drone.drone.flight.flying, 30.0, "off the ground", client.tello.takeoff, every_s=0.5
    )
    until(lambda: drone.drone.flight.state == "FLY", 15.0, "in the air")


def rest_s(client, name):
    """The longest time between two of these."""
    times = [t for t, _ in client.events[name]]
    return max(np.diff(times))


def test_tellopy_connects_flies_by_sticks_and_lands(tello_air, tmp_path):
    network = tello_air.network()
    drone = tello_air.drone(network, start_xyz_yaw=(1.0, 2.0, 0.0, 0.5))
    client = tello_air.client(network).connect()
    flight = until(lambda: client.newest("flight_data"), 5.0, "flight data")
    assert flight.em_ground and not flight.em_sky and flight.battery_percentage in (94, 95)
    wifi = until(lambda: client.newest("wifi"), 5.0, "Wi-Fi strength")
    assert wifi[0] == drone.drone.radio.strength
    assert client.tello.get_ssid() == "TELLO-FC5000"

    takes_off(client, drone)
    before, yaw = drone.position_m, 0.5
    client.tello.set_pitch(0.5)
    time.sleep(3.0)
    client.tello.set_pitch(0.0)
    until(lambda: np.linalg.norm(drone.drone.telemetry.v_ned_mps) < 0.3, 10.0, "stands again")
    moved = drone.position_m - before
    forward, left = moved[:2] @ [np.cos(yaw), np.sin(yaw)], moved[:2] @ [-np.sin(yaw), np.cos(yaw)]
    # half a stick: 1.1 m/s2 for 3 s, less drag; wind from aside
    assert forward > 1.5 and abs(left) < 0.25 * forward
    flight = client.newest("flight_data")
    # decimetres, 10 Hz
    assert flight.em_sky and flight.height == pytest.approx(10.0 * drone.position_m[2], abs=3.0)

    T = TruthReader(tmp_path, "tello1").latest()[1]  # where other simulated devices see it
    assert np.linalg.norm(T[:3, 3] - drone.position_m) < 0.2
    client.tello.land()
    until(lambda: not drone.drone.flight.flying, 15.0, "landed")
    until(lambda: client.newest("flight_data").em_ground, 3.0, "says that it landed")
    assert not client.errors and client.events["connected"] and rest_s(client, "flight_data") < 2.0


def test_its_log_holds_odometry_and_imu(tello_air):
    """MVO is a displacement from an origin that nobody knows; the IMU's accelerometer is in g, z
    down."""
    network = tello_air.network()
    drone = tello_air.drone(network, radio=WifiParameters(loss=0.0))
    client = tello_air.client(network).connect()
    takes_off(client, drone)
    until(lambda: len(client.events["sample_mvo"]) > 20, 20.0, "odometry")
    imu = client.newest("log_data").imu
    q = [imu.q0, imu.q1, imu.q2, imu.q3]
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-3)
    assert np.median([s.acc_z for _, s in client.events["sample_imu"][-20:]]) == pytest.approx(
        -1.0, abs=0.2
    )
    start_m, mvo_start = drone.position_m, client.newest("sample_mvo")
    client.tello.set_pitch(0.6)
    time.sleep(2.5)
    client.tello.set_pitch(0.0)
    time.sleep(4.0)  # stands, and odometry is at most 0.9 s late
    mvo, moved = client.newest("sample_mvo"), drone.position_m - start_m
    seen = np.subtract([mvo.pos_x, mvo.pos_y], [mvo_start.pos_x, mvo_start.pos_y])
    assert moved[0] > 1.5
    # drift, and 0.9 s of drifting
    assert np.linalg.norm(seen - moved[:2] * [1.0, -1.0]) < 0.2 * moved[0] + 0.3
    assert client.newest("log_data").mvo.tick == mvo.tick


def test_lands_after_15_s_without_sticks(tello_air):
    """tellopy sends sticks as long as it runs: the pilot's machine is switched off."""
    network = tello_air.network()
    drone = tello_air.drone(network)
    client = tello_air.client(network).connect()
    takes_off(client, drone)
    client.close()
    tello_air._things.remove(client)
    silent_s = time.monotonic()
    until(
        lambda: drone.drone.flight.state == "LANDING" or drone.drone.flight.why_landing,
        20.0,
        "lands by itself",
    )
    # its last stick was sent up to 2.1 s before close() returned
    assert time.monotonic() - silent_s > 12.0
    assert drone.drone.flight.why_landing == "alone"
    until(lambda: not drone.drone.flight.flying, 15.0, "landed")


@pytest.mark.parametrize("lost_s", [3.0, 10.0])
def test_seconds_of_lost_wifi(tello_air, lost_s):
    """It holds by its own flow sensor, tellopy says that it is disconnected, connects again, and
    flies it home.

    After 3 s tellopy asks for no connection as long as the Tello talks to it, which ends after 5 s
    of its silence.
    """
    network = tello_air.network()
    drone = tello_air.drone(network)
    client = tello_air.client(network).connect()
    takes_off(client, drone)
    client.tello.set_pitch(0.3)  # it is lost in the middle of a movement
    time.sleep(1.0)
    drone.drone.radio.cut(time.time(), lost_s)
    begun_s = time.monotonic()
    client.tello.set_pitch(0.0)
    until(lambda: client.events["disconnected"], 6.0, "tellopy knows")
    time.sleep(2.0)
    held_m = drone.position_m
    until(lambda: client.events["connected"][1:], 20.0, "connected again")
    assert time.monotonic() - begun_s > lost_s - 1.0
    # drifts 0.02 m/s
    assert drone.drone.flight.state == "FLY" and np.linalg.norm(drone.position_m - held_m) < 0.8
    data = until(
        lambda: [d for t, d in client.events["flight_data"] if t > begun_s + lost_s],
        5.0,
        "flight data",
    )[-1]
    assert data.em_sky
    client.tello.land()
    until(lambda: not drone.drone.flight.flying, 15.0, "landed")


def test_a_weak_lossy_radio_still_flies(tello_air):
    """A fifth of all packets lost: sticks come often enough that it does not let go."""
    network = tello_air.network()
    drone = tello_air.drone(network, radio=WifiParameters(loss=0.2, mean_delay_s=0.05))
    client = tello_air.client(network).connect(30.0)
    takes_off(client, drone)
    client.tello.set_yaw(0.5)
    until(lambda: abs(drone.drone.drone.felt.yaw_rad) > 1.0, 8.0, "turns")
    client.tello.set_yaw(0.0)
    until(lambda: not drone.drone.flight.flying, 30.0, "landed", client.tello.land, every_s=0.5)


def test_another_firmware_is_survived_and_seen(tello_air):
    """Flight data of 18 bytes: tellopy makes all of it 0, which is no empty battery."""
    network = tello_air.network()
    drone = tello_air.drone(network, drone=DroneParameters(other_firmware=True))
    client = tello_air.client(network).connect()
    takes_off(client, drone)
    unknown = until(lambda: client.events["sample_raw"], 10.0, "a log record that nobody knows")
    assert (
        client.newest("flight_data").battery_percentage == 0
        and drone.drone.flight.battery.percent > 90
    )
    assert unknown[0][1].record_id == 4242 and client.events["sample_imu"] and not client.errors


def test_without_namespaces_the_client_is_told_another_address(tello_air):
    """Two on loopback: tellopy's address is set before it connects, its ports differ; nothing else
    is changed."""
    ports = free_udp_port(), free_udp_port()
    first, second = (
        tello_air.drone("", name, address="127.0.0.1", port=port, video_port=port + 1)
        for name, port in zip(("tello1", "tello2"), ports)
    )
    client = tello_air.client(
        address=("127.0.0.1", ports[1]), port=free_udp_port(), video_port=ports[1] + 1
    )
    takes_off(client.connect(), second)
    assert not first.drone.flight.flying and first.drone.link.client is None and not client.errors


def test_as_a_program_it_says_where_it_is_and_leaves_no_namespace(tello_air, tmp_path):
    network = tello_air.network()
    command = [
        sys.executable,
        "-m",
        "fcsv_sim.tello.command",
        "--network",
        network,
        "--sim-dir",
        str(tmp_path),
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert f"{network}-pilot" in process.stdout.readline()
        client = tello_air.client(network).connect()
        until(lambda: client.newest("flight_data"), 5.0, "flight data")
    finally:
        process.terminate()
        assert process.wait(10.0) == 0
    until(lambda: not netns.exists(f"{network}-pilot"), 5.0, "the namespaces are removed")


def test_by_its_launch_file_beside_a_master(ros_master, tello_air, tmp_path):
    network = tello_air.network()
    launched = ros_master.launch(
        "fcsv_bringup",
        "sim_tello_drone.launch",
        uav="tello1",
        sim_dir=tmp_path,
        network=network,
        world="plain",
    )
    try:
        until(
            lambda: netns.exists(f"{network}-pilot") or launched.returncode is not None,
            30.0,
            "the namespaces",
        )
        client = tello_air.client(network).connect(30.0)
        client.tello.takeoff()
        until(
            lambda: TruthReader(tmp_path, "tello1").latest()[1][2, 3] > 0.5, 15.0, "its truth rises"
        )
        client.tello.start_video()
        # the renderer is compiled at its first use
        until(lambda: client.events["video_data"], 120.0, "video")
    finally:
        launched.stop()
    until(lambda: not netns.exists(f"{network}-pilot"), 10.0, "the namespaces are removed")
