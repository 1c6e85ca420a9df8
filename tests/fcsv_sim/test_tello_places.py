# SPDX-License-Identifier: Apache-2.0
"""Where simulated Tellos are on one computer: in namespaces, or on loopback where these are not
permitted."""

import time

from support.launched import launched
from support.tello_air import until

from fcsv_geometry.programs import netns
from fcsv_sim.demo.truth_export import export_truth
from fcsv_sim.machines import namespaces
from fcsv_sim.tello.places import places

VEHICLES = ("tello1", "tello2")


def test_in_namespaces_each_is_at_its_usual_address_and_may_be_switched_off_and_on(tello_air):
    with places(VEHICLES) as (found, words):
        assert not words and len({p.network for p in found.values()}) == 2
        assert {(p.address, p.port) for p in found.values()} == {("192.168.10.1", 8889)}
        place = found["tello2"]
        drone = tello_air.drone(**place.drone)
        client = tello_air.client(place.network).connect()
        drone.close()
        tello_air._things.remove(drone)
        until(lambda: client.events["disconnected"], 6.0, "tellopy knows")
        assert netns.exists(place.link["network"])
        begun_s = time.monotonic()
        tello_air.drone(**place.drone)
        until(
            lambda: [t for t, _ in client.events["connected"] if t > begun_s],
            15.0,
            "connected again",
        )
        tello_air.close()
    assert not [p for p in found.values() if netns.exists(f"{p.network}-device")]


def test_where_namespaces_are_not_permitted_it_says_so_and_ports_differ(monkeypatch, tmp_path):
    monkeypatch.setattr(
        namespaces, "permitted", lambda: "no network namespaces here (ip: Operation not permitted)"
    )
    with places(VEHICLES) as (found, words):
        assert "not permitted" in words and "loopback" in words
        ports = [n for p in found.values() for n in (p.port, p.client_port, p.video_port)]
        assert len(set(ports)) == 6 and {p.address for p in found.values()} == {"127.0.0.1"}
        assert not any(p.network or p.link["network"] for p in found.values())


def test_its_launch_file_takes_none_for_no_namespace_and_no_video(root):
    """roslaunch gives an empty argument the default."""
    launch = str(root / "launch/sim_tello_drone.launch")
    for words, expected in (
        ((), ("fcsv-tello1", "street")),
        (("network:=none", "world:=none"), ("", "")),
    ):
        params = launched(launch, "uav:=tello1", *words)["params"]
        found = (params[f"/tello1/tello_drone/{name}"] for name in ("network", "video/world"))
        assert tuple(found) == expected


def test_on_loopback_it_is_flown(tello_air, monkeypatch):
    monkeypatch.setattr(namespaces, "permitted", lambda: "no")
    with places(VEHICLES) as (found, _):
        place = found["tello1"]
        drone = tello_air.drone(**place.drone)
        link = place.link
        client = tello_air.client(
            address=(link["address"], link["tello_port"]),
            port=link["port"],
            video_port=link["video_port"],
        )
        client.connect().tello.takeoff()
        until(lambda: drone.drone.flight.flying, 10.0, "takes off")
        tello_air.close()


def test_pictures_without_stamps_of_their_own_get_the_truth_that_is_nearest(tmp_path):
    """The third was never taken; another vehicle's pictures, which have stamps, are as they were
    noted."""
    head = "stamp_s,vehicle,x\n"
    notes = head + "10.0,tello1,0.0\n10.3,tello1,1.0\n10.6,tello1,2.0\n10.9,te"
    (tmp_path / "truth_cameras_tello1.csv").write_text(notes)
    (tmp_path / "truth_cameras_uav1.csv").write_text(head + "10.1,uav1,7.0\n")
    folder = export_truth(tmp_path, tmp_path, ("tello1", "uav1"), {"tello1": [10.05, 10.52, 30.0]})
    rows = [line.split(",") for line in (folder / "cameras.csv").read_text().split()[1:]]
    assert [(float(s), x) for s, _, x in rows] == [(10.05, "0.0"), (10.52, "2.0"), (10.1, "7.0")]
