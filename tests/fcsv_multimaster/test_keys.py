# SPDX-License-Identifier: Apache-2.0
"""Keys of a fleet: whose they are, who may read them, how long they last, which are revoked; and
ROS beside them."""

import datetime
import doctest
import shutil
import socket
import time
from contextlib import ExitStack, closing

import pytest
from support.waiting import within

from fcsv_multimaster.errors import KeyringError
from fcsv_multimaster.keys import keys_command, revocation
from fcsv_multimaster.keys.keyring import make_fleet, open_keyring, revoke
from fcsv_multimaster.links import load_links
from fcsv_multimaster.network import exposure
from fcsv_multimaster.network.endpoints import parse_endpoint
from fcsv_multimaster.relay.exchange import Exchange
from fcsv_sim.machines.machines import free_port

until = within(30.0)


def test_keys_of_a_fleet_open_and_others_do_not(tmp_path):
    make_fleet(tmp_path / "a", ["control", "uav1"])
    make_fleet(tmp_path / "b", ["uav1"])
    ring = open_keyring(tmp_path / "a/uav1", "uav1")
    assert ring.key.stat().st_mode & 0o077 == 0
    before = ring.certificate.read_bytes()
    make_fleet(tmp_path / "a", ["uav1", "uav2"])  # a vehicle more: the others keep their keys
    assert ring.certificate.read_bytes() == before and open_keyring(tmp_path / "a/uav2", "uav2")
    with pytest.raises(KeyringError, match="belongs to 'uav1'"):
        open_keyring(tmp_path / "a/uav1", "control")
    (tmp_path / "a/uav1/fleet.pem").write_bytes((tmp_path / "b/fleet.pem").read_bytes())
    with pytest.raises(KeyringError, match="not of the fleet"):
        open_keyring(tmp_path / "a/uav1", "uav1")
    (tmp_path / "b/uav1/machine.key").unlink()
    with pytest.raises(KeyringError, match="machine.key: is missing"):
        open_keyring(tmp_path / "b/uav1", "uav1")


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o601])
def test_a_key_that_others_may_read_is_refused(tmp_path, mode):
    make_fleet(tmp_path, ["uav1"])
    key = tmp_path / "uav1/machine.key"
    key.chmod(mode)
    with pytest.raises(
        KeyringError, match=f"machine.key: others may read it .mode {mode:04o}.; `chmod 600"
    ):
        open_keyring(tmp_path / "uav1", "uav1")
    key.chmod(0o400)
    assert open_keyring(tmp_path / "uav1", "uav1")
    (tmp_path / "fleet.key").chmod(mode)
    with pytest.raises(KeyringError, match="fleet.key: others may read it"):
        make_fleet(tmp_path, ["uav2"])


def test_keys_that_run_out_are_said_thirty_days_before(tmp_path):
    make_fleet(tmp_path, ["uav1"], days=400)
    ring, day = open_keyring(tmp_path / "uav1", "uav1"), datetime.timedelta(days=1)
    assert ring.warning(ring.runs_out - 30.1 * day) == ""
    assert "in 29 days; all machines need keys from a new folder" in ring.warning(
        ring.runs_out - 29.9 * day
    )
    make_fleet(tmp_path, ["uav2"], days=20)  # one machine's, from a fleet that lasts
    before = (tmp_path / "uav2/machine.pem").read_bytes()
    said = open_keyring(tmp_path / "uav2", "uav2").warning(datetime.datetime.utcnow())
    assert "in 19 days; make new ones and copy them here" in said
    make_fleet(tmp_path, ["uav1", "uav2"], days=300)
    assert (tmp_path / "uav2/machine.pem").read_bytes() != before
    assert open_keyring(tmp_path / "uav2", "uav2").warning(datetime.datetime.utcnow()) == ""


def test_revoked_keys_open_nothing_and_their_successors_do(tmp_path, capsys):
    assert doctest.testmod(revocation).failed == 0 and doctest.testmod(exposure).failed == 0
    fleet = tmp_path / "fleet"
    make_fleet(fleet, ["control", "uav1"])
    shutil.copytree(fleet / "uav1", tmp_path / "stolen")
    assert open_keyring(fleet / "control", "control").revoked.good_name("uav1") == "uav1"
    assert keys_command.main(["revoke", str(fleet), "uav1"]) == 0
    said = capsys.readouterr().out
    assert f"{fleet}/control/revoked.json  -> copy" in said and "uav1/revoked.json" not in said
    with pytest.raises(KeyringError, match="machine.pem: is revoked; make new keys for uav1"):
        open_keyring(fleet / "uav1", "uav1")
    with pytest.raises(KeyringError, match="is revoked already"):
        revoke(fleet, ["uav1"])
    make_fleet(fleet, ["uav1"])
    assert open_keyring(fleet / "uav1", "uav1")
    # the thief has the old folder without the list; the others let in another name than his
    assert open_keyring(tmp_path / "stolen", "uav1").revoked.good_name("uav1") == "uav1"
    assert open_keyring(fleet / "control", "control").revoked.good_name("uav1") == "uav1.2"


def test_a_list_of_revoked_keys_that_is_not_the_fleets_is_refused(tmp_path):
    make_fleet(tmp_path / "a", ["uav1"])
    make_fleet(tmp_path / "b", ["uav1"])
    path = tmp_path / "a/uav1/revoked.json"
    for text, why in (
        ((tmp_path / "b/revoked.json").read_text(), "was not signed by this fleet"),
        (path.read_text().replace("{}", '{"uav2": 1}'), "was not signed by this fleet"),
        ("[]", "is no list"),
        ('{"revoked": 3}', "is no list"),
        ("", "is no list"),
    ):
        path.write_text(text)
        with pytest.raises(KeyringError, match=why):
            open_keyring(tmp_path / "a/uav1", "uav1")
    with pytest.raises(KeyringError, match="'uav9' has no keys"):
        revoke(tmp_path / "b", ["uav9"])
    with pytest.raises(KeyringError, match="has no fleet.key"):
        revoke(tmp_path / "b/uav1", ["uav1"])


# ---- ROS beside the keys -------------------------------------------------------------------------

AT_HOME = [("127.0.0.1", 11311), ("0.0.0.0", 22)]


@pytest.mark.parametrize(
    "master, nodes, ends, said",
    [
        (
            "http://127.0.0.1:11311",
            {"/a": "http://127.0.0.1:40001/", "/b": "http://localhost:2"},
            AT_HOME,
            [],
        ),
        ("http://localhost:11311", {}, [("::1", 11311)], []),
        (
            "http://127.0.0.1:11311",
            {},
            [("0.0.0.0", 11311)],
            ["the ROS master listens on 0.0.0.0:11311"],
        ),
        ("http://127.0.0.1:11311", {}, [("::", 11311)], ["the ROS master listens on :::11311"]),
        ("http://uav1:11311", {}, AT_HOME, []),
        (
            "http://control:11311",
            {},
            AT_HOME[1:],
            ["the ROS master is on another machine (http://control:11311)"],
        ),
        (
            "http://127.0.0.1:11311",
            {"/rviz": "http://10.0.0.7:3/"},
            AT_HOME,
            ["/rviz announces itself as 10.0.0.7"],
        ),
    ],
)
def test_ros_that_others_reach_is_named(master, nodes, ends, said):
    assert exposure.exposed(master, nodes, ends) == said


def test_a_socket_that_listens_is_found():
    with socket.socket() as here, socket.socket() as everywhere:
        for end, address in ((here, "127.0.0.1"), (everywhere, "0.0.0.0")):
            end.bind((address, 0))
            end.listen()
        assert {here.getsockname(), everywhere.getsockname()} <= set(exposure.listening())


# ---- on the link ---------------------------------------------------------------------------------


@pytest.fixture
def link(tmp_path):
    """link(machine, keys, heard, problems) joins control and uav1 on loopback, with certificates;
    closed at the end."""
    path = tmp_path / "links.yaml"
    path.write_text("""
classes: {stream: {link: urgent, priority: data_high, reliable: true, max_age_s: 5.0}}
to_control: [{topic: "/{vehicle}/up", class: stream}]
to_vehicle: [{topic: "/{vehicle}/down", class: stream}]
""")
    ends = {}
    with ExitStack() as stack:

        def join(name, keys, heard, problems=None):
            here = ends[name] = parse_endpoint(f"127.0.0.1:{free_port()}/{free_port()}")
            # one knows where the other is
            peers = {n: ends.get(n, here) for n in ("control", "uav1") if n != name}
            made = Exchange(
                name,
                load_links(path),
                here,
                peers,
                open_keyring(keys, name),
                lambda parcel: heard.append(parcel.data),
                print,
                lambda *problem: (problems if problems is not None else {}).update([problem]),
            )
            stack.enter_context(closing(made))
            return made

        yield join


def test_who_has_revoked_keys_is_not_heard_and_hears_nothing(link, tmp_path):
    fleet, at_control, at_thief, at_uav1 = tmp_path / "fleet", [], [], []
    make_fleet(fleet, ["control", "uav1"])
    shutil.copytree(fleet / "uav1", tmp_path / "stolen")
    revoke(fleet, ["uav1"])
    make_fleet(fleet, ["uav1"])
    control, thief = (
        link("control", fleet / "control", at_control),
        link("uav1", tmp_path / "stolen", at_thief),
    )

    def speak(uav1, word):
        uav1.send("/uav1/up", "std_msgs/String", "0" * 32, "", word)
        control.send("/uav1/down", "std_msgs/String", "0" * 32, "", b"order")

    begun_s = time.monotonic()
    while time.monotonic() < begun_s + 3.0:  # who may speak is heard within one, see below
        speak(thief, b"stolen")
        time.sleep(0.05)
    assert at_control == [] and at_thief == []
    thief.close()
    uav1 = link("uav1", fleet / "uav1", at_uav1)
    until(
        lambda: at_control and at_uav1,
        what="both hear each other",
        meanwhile=lambda: speak(uav1, b"good"),
        every_s=0.05,
    )
    assert set(at_control) == {b"good"} and set(at_uav1) == {b"order"}


def test_of_two_vehicles_with_one_name_the_second_is_refused_named_and_told(link, tmp_path):
    make_fleet(tmp_path, ["control", "uav1"])
    heard, problems = {n: [] for n in "c12"}, {n: {} for n in "c12"}
    control = link("control", tmp_path / "control", heard["c"], problems["c"])
    vehicles = {"1": link("uav1", tmp_path / "uav1", heard["1"], problems["1"])}
    numbers = iter(range(100000))

    def speak():
        control.send("/uav1/down", "std_msgs/String", "0" * 32, "", b"%d" % next(numbers))
        for word, uav1 in vehicles.items():
            uav1.send("/uav1/up", "std_msgs/String", "0" * 32, "", word.encode())

    def speak_until(condition, what, timeout_s=30.0):
        until(condition, timeout_s, what, meanwhile=speak, every_s=0.05)

    speak_until(lambda: heard["c"] and heard["1"], "control and the first hear each other")
    vehicles["2"] = link("uav1", tmp_path / "uav1", heard["2"], problems["2"])
    speak_until(
        lambda: "two machines call themselves uav1" in problems["c"].get("twin uav1", ""),
        "control names it",
    )
    assert f"refused: host {socket.gethostname()} at" in problems["c"]["twin uav1"]
    speak_until(
        lambda: "control refuses this machine" in problems["2"].get("displaced control", ""),
        "it is told",
    )
    vehicles.pop("1").close()  # as a cut would have it
    end_s = time.monotonic() + 3.0
    speak_until(lambda: time.monotonic() > end_s, "time passes")
    assert set(heard["c"]) == {b"1"} and heard["1"] and heard["2"] == []
    assert problems["1"].get("displaced control", "") == ""
