# SPDX-License-Identifier: Apache-2.0
"""Bags that were cut or damaged: what is salvaged, compared with what rosbag reads, and what is
refused."""

import fcntl
import io
import os
import random
import tempfile

import genpy
import pytest
import rosbag
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Header, String

from fcsv_geometry.bags import repair
from fcsv_geometry.bags.records import MAGIC
from fcsv_geometry.bags.salvage import is_whole, salvage
from fcsv_geometry.errors import BagError

COUNT = 60


def write(path, close=True, compression="none", count=COUNT):
    """Numbered messages on two topics in chunks of 1 kB, the last one open where the bag is not
    closed."""
    bag = rosbag.Bag(str(path), "w", compression=compression, chunk_threshold=1000)
    for i in range(count):
        stamp = genpy.Time(100 + i // 10, i % 10 * 10**8)
        bag.write("/a", Header(seq=i, stamp=stamp, frame_id="x" * (i % 70)), stamp)
        if i >= 20:  # a connection that comes later
            bag.write("/b", String(data=str(i)), stamp + genpy.Duration(0, 1))
    if close:
        bag.close()
    else:
        bag._file.flush()
        bag._file.close()
    return path.read_bytes()


def read(data):
    """(topic, number, stamp) of every message, as rosbag reads them."""
    with tempfile.NamedTemporaryFile(suffix=".bag") as file:
        file.write(data)
        file.flush()
        with rosbag.Bag(file.name) as bag:
            return [
                (t, m.seq if t == "/a" else int(m.data), stamp.to_nsec())
                for t, m, stamp in bag.read_messages()
            ]


def salvaged(data):
    out = io.BytesIO()
    found = salvage(data, out)
    return found, out.getvalue()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write(tmp_path_factory.mktemp("bags") / "whole.bag")


def test_a_closed_bag_is_whole_and_stays_the_same_to_its_last_message(whole):
    assert is_whole(whole)
    found, again = salvaged(whole)
    assert read(again) == read(whole) and len(read(whole)) == 2 * COUNT - 20 and is_whole(again)
    assert found.topics == {"/a": COUNT, "/b": COUNT - 20} and found.lost_bytes == 0
    assert (found.first_s, found.last_s) == pytest.approx((100.0, 105.9))


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_cut_anywhere_every_message_before_the_cut_is_there(whole, tmp_path, compression):
    data = (
        whole if compression == "none" else write(tmp_path / "packed.bag", compression=compression)
    )
    everything, last = read(data), 0

    @given(st.integers(len(MAGIC) + 4096, len(data) - 1))
    def cut(at):
        found, again = salvaged(data[:at])
        assert not is_whole(data[:at]) and is_whole(again)
        kept = read(again) if found.messages else []
        assert kept == everything[: len(kept)] and len(kept) == found.messages
        nonlocal last
        last = max(last, len(kept))

    cut()
    assert last > len(everything) // 2
    if compression == "none":
        for at in random.Random(1).sample(range(5000, len(data)), 40):
            assert salvaged(data[:at])[0].lost_bytes < 750, (
                "less than the longest record, a connection's"
            )


def test_a_bag_whose_recorder_was_killed_has_its_open_chunk(tmp_path):
    data = write(tmp_path / "x.bag.active", close=False)
    with pytest.raises(rosbag.ROSBagException):
        read(data)
    found, again = salvaged(data)
    assert len(read(again)) == 2 * COUNT - 20 == found.messages


def test_a_damaged_place_costs_its_chunk_and_not_what_follows(whole):
    everything = read(whole)
    chunks = [i for i in range(len(whole)) if whole.startswith(b"op=\x05", i)]
    assert len(chunks) > 5
    for filling in (b"\0", b"\xff"):
        # a record's header, a chunk's inside
        for at in (chunks[3] - 30, chunks[3] + 60, chunks[4] - 1):
            damaged = whole[:at] + filling * 40 + whole[at + 40 :]
            found, again = salvaged(damaged)
            kept = read(again)
            assert (
                set(kept) < set(everything)
                and len(kept) > 0.8 * len(everything)
                and found.lost_bytes >= 40
            )
            assert kept[-1] == everything[-1]
    no_connections = whole[: chunks[0] + 40] + b"\0" * 60 + whole[chunks[0] + 100 :]
    assert len(read(salvaged(no_connections)[1])) > 0.8 * len(everything), (
        "the index at the end names them too"
    )


@given(st.binary(max_size=300))
def test_noise_after_the_first_line_is_no_message(noise):
    found, again = salvaged(MAGIC + noise)
    assert not found.messages and not is_whole(MAGIC + noise) and is_whole(again)


# ---- files ---------------------------------------------------------------------------------------


def test_an_unclosed_bag_gets_its_name_and_the_original_stays(tmp_path):
    active = tmp_path / "uav1.bag.active"
    data = write(active, close=False)
    path, found = repair.repaired(active)
    assert path == tmp_path / "uav1.bag" and found.messages == 2 * COUNT - 20 and repair.check(path)
    assert (tmp_path / "uav1.bag.broken").read_bytes() == data
    assert sorted(p.name for p in tmp_path.iterdir()) == ["uav1.bag", "uav1.bag.broken"]
    assert repair.repaired(path) == (path, None)


def test_a_bag_that_was_whole_but_not_named_is_only_named(tmp_path):
    data = write(tmp_path / "uav1.bag.active")
    assert repair.repaired(tmp_path / "uav1.bag.active") == (tmp_path / "uav1.bag", None)
    assert [p.name for p in tmp_path.iterdir()] == ["uav1.bag"] and (
        tmp_path / "uav1.bag"
    ).read_bytes() == data


def test_a_cut_bag_is_repaired_in_its_place_and_an_earlier_original_is_not_written_over(
    tmp_path, whole
):
    path = tmp_path / "uav1.bag"
    path.write_bytes(whole[:9000])
    (tmp_path / "uav1.bag.broken").write_bytes(b"of an earlier repair")
    assert repair.repaired(path)[1].messages > 10 and read(path.read_bytes())
    assert (tmp_path / "uav1.bag.broken-2").read_bytes() == whole[:9000]
    assert (tmp_path / "uav1.bag.broken").read_bytes() == b"of an earlier repair"


@pytest.mark.parametrize(
    "data, words",
    [
        (
            b"#ROSBAG V1.2\n" + b"x" * 99,
            "is a bag of version 1.2, only 2.0 is read; convert it: rosbag filter",
        ),
        (b"#ROSRECORD V1.1\n" + b"x" * 99, "is a bag of version 1.1"),
        (b"#ROSBAG V3.0\n", "is a bag of version 3.0"),
        (b"ply\nformat ascii\n", "is not a bag"),
        (b"", "is not a bag"),
        (MAGIC, "holds no whole message"),
        (MAGIC + b"\0" * 5000, "holds no whole message"),
    ],
)
def test_what_cannot_be_repaired_is_named_and_left_alone(tmp_path, data, words):
    path = tmp_path / "uav1.bag"
    path.write_bytes(data)
    with pytest.raises(BagError, match=words) as error:
        repair.repaired(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)
    assert [p.name for p in tmp_path.iterdir()] == ["uav1.bag"] and path.read_bytes() == data


def test_a_bag_that_is_being_recorded_is_left_alone(tmp_path):
    active = tmp_path / "uav1.bag.active"
    data = write(active, close=False)
    with active.open("rb") as recorder:
        fcntl.flock(recorder, fcntl.LOCK_EX)
        with pytest.raises(BagError, match="is being recorded now; stop the recorder first"):
            repair.repaired(active)
    assert active.read_bytes() == data and not (tmp_path / "uav1.bag").exists()


def test_a_full_disk_is_said_before_anything_is_written(tmp_path, monkeypatch):
    active = tmp_path / "uav1.bag.active"
    data = write(active, close=False)
    monkeypatch.setattr(
        repair.shutil, "disk_usage", lambda _: os.statvfs_result and type("U", (), {"free": 10_000})
    )
    with pytest.raises(BagError, match="1 MiB are needed on its disk, 0 are free"):
        repair.repaired(active)
    assert [p.name for p in tmp_path.iterdir()] == [
        "uav1.bag.active"
    ] and active.read_bytes() == data


def test_two_bags_of_one_name_are_left_to_the_user(tmp_path):
    write(tmp_path / "uav1.bag.active", close=False)
    write(tmp_path / "uav1.bag")
    with pytest.raises(BagError, match="uav1.bag is there too"):
        repair.repaired(tmp_path / "uav1.bag.active")
