# SPDX-License-Identifier: Apache-2.0
"""The links file and addresses."""

import pytest

from fcsv_geometry.errors import ConfigError
from fcsv_multimaster.errors import EndpointError
from fcsv_multimaster.links import load_links
from fcsv_multimaster.network.endpoints import Endpoint, parse_endpoint, parse_peers


def test_shipped_links_carry_what_they_must_and_no_raw_pictures(root):
    links = load_links(root / "config/links/default.yaml")
    up = links.crossing("uav1", "control")
    assert {
        "/uav1/odometry/state",
        "/uav1/tags/detections",
        "/uav1/command_ack",
        "/uav1/mavros/state",
    } <= set(up)
    assert {
        "/uav1/odometry/epoch",
        "/uav1/agent/alive",
        "/uav1/guardian/state",
        "/uav1/guardian/said",
    } <= set(up)
    assert {"/uav1/flight_check", "/uav1/flight_link/parameters"} <= set(up)
    down = links.crossing("control", "uav2")
    assert set(down) == {
        "/uav2/command",
        "/uav2/clock/ping",
        "/uav2/clock/offset",
        "/calibration",
        "/home",
        "/mission/state",
        "/calibration_epochs",
        "/mission/alive",
        "/mission/fence",
        "/mission/capture",
    }
    assert set(links.crossing("uav1", "uav2")) == {
        "/uav1/odometry/state",
        "/uav1/mavros/state",
        "/uav1/guardian/state",
    }
    everything = [*up, *down]
    assert not [
        t
        for t in everything
        if t.endswith(("image_raw", "odometry/body", "/rosout", "/clock", "/tf"))
    ]
    assert links.crossing("uav1", "uav1") == {}


@pytest.mark.parametrize(
    "text, word",
    [
        ("classes: {}\nto_moon: []", "unknown key 'to_moon'"),
        ("classes: {a: {link: radio, priority: data, reliable: true}}", "classes.a.link"),
        ("classes: {a: {link: bulk, priority: high, reliable: true}}", "classes.a.priority"),
        (
            "classes: {a: {link: bulk, priority: data, reliable: true, rate_hz: -1}}",
            "classes.a.rate_hz",
        ),
        ("classes: {}\nto_control: [{topic: /x, class: b}]", "to_control[0].class"),
        (
            "classes: {a: {link: bulk, priority: data, reliable: true}}\nto_control: [{topic: x, class: a}]",
            "begin with /",
        ),
        (
            "classes: {a: {link: bulk, priority: data, reliable: true}}\nto_control: [{topic: /x, class: a, hz: 2}]",
            "hz",
        ),
    ],
)
def test_errors_name_file_and_field(tmp_path, text, word):
    path = tmp_path / "links.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as error:
        load_links(path)
    assert "links.yaml" in str(error.value) and word in str(error.value)


def test_addresses():
    assert parse_endpoint("10.0.0.1:7447") == Endpoint("10.0.0.1", 7447, 7448)
    assert parse_peers("a=h:1/5,b=h:2") == {"a": Endpoint("h", 1, 5), "b": Endpoint("h", 2, 3)}


def test_a_peer_without_an_address_needs_discovery():
    assert parse_peers("a,b=h:2", discovery=True) == {"a": None, "b": Endpoint("h", 2, 3)}
    with pytest.raises(EndpointError, match="write a=HOST:PORT, or start with discovery:=true"):
        parse_peers("a")


@pytest.mark.parametrize("text", ["a", "a=h", "a=h:x", "a=h:70000", "a=h:1,a=h:2", "=h:1"])
def test_bad_addresses(text):
    with pytest.raises(EndpointError):
        parse_peers(text)
