# SPDX-License-Identifier: Apache-2.0
"""What the report calls pictures, and what stands at its top."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fcsv_stereo.map_files.table import demo_table
from fcsv_stereo.model import Configuration, ImageEntry
from fcsv_stereo.report import pictures, plain_words
from fcsv_stereo.report.naming import named, picture_names
from fcsv_stereo.report.origin import Origin
from fcsv_stereo.report.page import write_report

BEGAN_S = 1795759387.0


def entry(vehicle, after_s, name=None):
    stamp_s = BEGAN_S + after_s
    return ImageEntry(name or f"{vehicle}/{stamp_s:.3f}", vehicle, stamp_s, np.eye(4), np.eye(4))


def pair(configuration, reference, other, *tried):
    return SimpleNamespace(
        configuration=Configuration("horizontal", 2.0, 0.0, configuration),
        reference_name=reference.name,
        other_name=other.name,
        candidates=[(e.name, 0.5) for e in (other, *tried)],
        match_rate=0.5,
    )


@pytest.fixture
def flown(tiny_map):
    """A reference with two pairs, for one of which two pictures were tried; a picture of no
    pair."""
    ref, a, b, c, rest = (
        entry("uav1", 0),
        entry("uav2", 3),
        entry("uav2", 1),
        entry("uav2", 9),
        entry("uav2", 20),
    )
    reference = replace(tiny_map.reference, name=ref.name, stamp_s=ref.stamp_s)
    return replace(
        tiny_map,
        reference=reference,
        images=[ref, a, b, c, rest],
        watched=[c.name],
        pairs=[pair("2 m", ref, a, b), pair("8 m", ref, c)],
        warnings=[f"{a.name} is dark"],
        skews_s={c.name: 0.1},
    )


def test_pictures_are_named_by_configuration_and_number(flown):
    names = ["uav1, reference", "uav2, 2 m, 2", "uav2, 2 m, 1", "uav2, 8 m", "uav2, of no pair"]
    assert list(map(picture_names(flown).get, (i.name for i in flown.images))) == names
    shown = named(flown)
    assert [i.name for i in shown.images] == names and shown.reference.name == names[0]
    assert [(p.reference_name, p.other_name) for p in shown.pairs] == [
        (names[0], names[1]),
        (names[0], names[3]),
    ]
    assert (
        shown.pairs[0].candidates == [(names[1], 0.5), (names[2], 0.5)]
        and shown.pairs[0].match_rate == 0.5
    )
    assert shown.warnings == ["uav2, 2 m, 2 is dark"] and shown.skews_s == {names[3]: 0.1}
    assert shown.watched == [names[3]]


def test_photographs_keep_their_names_and_have_no_vehicle(flown):
    images = [replace(i, name=f"{n}.jpg", vehicle="camera") for n, i in enumerate(flown.images)]
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    images[1] = replace(images[1], T_home_cam=turned)
    photographs = replace(
        flown, images=images, reference=replace(flown.reference, name="0.jpg"), pairs=[]
    )
    assert picture_names(photographs) == {}
    (warning,) = [
        w for w in plain_words.warnings(photographs, [], [], None) if "moved pictures" in w
    ]
    assert "vehicle" not in warning and "the model" in warning
    table, *_ = pictures.pictures(SimpleNamespace(result=photographs))
    assert table.head[:2] == ["picture", "role"] and not any(
        "179575" in c for row in table.rows for c in row
    )
    assert all(len(row) == len(table.head) for row in table.rows)
    flights, *_ = pictures.pictures(SimpleNamespace(result=named(flown)))
    assert "vehicle" in flights.head and flights.rows[0][2] == "2026-11-27 06:03:07.000 UTC"
    assert not any("179575" in c for row in flights.rows for c in row)


def test_where_a_map_comes_from_stands_at_the_top(tiny_map, tmp_path):
    (tmp_path / "session.yaml").write_text("mission: {name: five}\nsimulation: {seed: 7}\n")
    origin = Origin.of(tmp_path, "fcsv map 'a b' -o <out>", BEGAN_S)
    text = write_report(tiny_map, tmp_path, origin=origin).read_text()
    head = text[: text.index("<h2")]
    for words in (
        str(tmp_path),
        "five",
        "seed 7",
        "2026-11-27 06:03:07.000 UTC",
        "fcsv map &#39;a b&#39; -o &lt;out&gt;",
        "<td>version</td>",
    ):
        assert words in head
    assert "mission" not in dict(Origin.of(tmp_path / "none", "", BEGAN_S).rows(tiny_map))


@pytest.mark.parametrize("text", ["[1]", "mission: 3\nsimulation: x\n", ": :"])
def test_a_session_that_does_not_say_its_mission_has_none(tmp_path, text):
    (tmp_path / "session.yaml").write_text(text)
    found = Origin.of(tmp_path, "", BEGAN_S)
    assert (found.mission, found.seed) == ("", None)


def test_rows_of_the_table_are_told_apart():
    """Names that agree in their first forty letters."""
    names = [f"photographs/of/the/northern/quarry/0000.jpg with 000{n}.jpg" for n in range(4)]
    rows = [{"name": n, "effective_range_m": [1, 9], "match_rate": 0.5} for n in names]
    document = {
        "method": "joint",
        "reference": {"image": "a"},
        "points": 1,
        "configurations": rows,
        "coverage": 1.0,
        "timing_s": {"total": 1.0},
    }
    lines = demo_table(document).splitlines()
    assert (
        all(any(line.startswith(n) for line in lines) for n in names)
        and len(set(map(len, lines[1:6]))) == 1
    )
