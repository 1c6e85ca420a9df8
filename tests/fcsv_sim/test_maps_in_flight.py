# SPDX-License-Identifier: Apache-2.0
"""What a demo says of the map in flight."""

from types import SimpleNamespace

from fcsv_sim.demo.maps_in_flight import MapsInFlight


def state(word, configurations=1, detail="horizontal 2 m"):
    return SimpleNamespace(
        state=word,
        detail=detail,
        configurations=configurations,
        points=1000,
        latency_s=1.5,
        processing_s=0.75,
    )


def test_the_last_finished_map_counts_from_the_first_set_point():
    maps = MapsInFlight()
    maps.begin(100.0)
    maps.begin(150.0)  # the second configuration
    assert maps.on_map_state(state("partial"), 110.0).startswith(
        "first look in flight: 1 configurations, 1000 points, 1.5 s"
    )
    assert maps.in_words() is None  # a look is no map
    assert maps.on_map_state(state("ready"), 111.0).endswith("11.0 s after the first set-point")
    assert maps.on_map_state(state("ready"), 112.0) is None  # repeated once a second
    maps.on_map_state(state("ready", 3), 123.25)
    maps.on_map_state(state("partial", 3), 130.0)
    assert (
        "23.2 s by the flight's clock, 0.8 s of them its making, 3 configurations"
        in maps.in_words()
    )


def test_nothing_is_made_up():
    maps = MapsInFlight()
    assert (
        maps.on_map_state(state("mapping"), 1.0) is None
        and maps.on_map_state(state("waiting"), 1.0) is None
    )
    assert (
        maps.on_map_state(state("failed", detail="no picture"), 2.0) == "map in flight: no picture"
    )
    assert (
        maps.on_map_state(state("ready"), 3.0).endswith("after the last picture")
        and maps.in_words() is None
    )
