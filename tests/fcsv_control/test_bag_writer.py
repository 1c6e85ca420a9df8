# SPDX-License-Identifier: Apache-2.0
"""The recorder's writer without a master, in a process of its own that is killed, or whose disk
refuses."""

import io
import os
import signal
import subprocess
import sys
import time

import genpy
import pytest
import rosbag
import rospy
from std_msgs.msg import String
from support.waiting import within

from fcsv_control.recording import begin
from fcsv_control.ros.recording.bag_writer import BagWriter
from fcsv_geometry.bags.parts import parts_in
from fcsv_geometry.bags.repair import check, repaired
from fcsv_geometry.errors import BagError

until = within(20.0)
# puts numbered messages (100 a second, 20 kB each) and says when it did: a line per message
WRITER = """
import io, resource, sys, time
from pathlib import Path
import genpy, rospy
from std_msgs.msg import String
from fcsv_control.ros.recording.bag_writer import BagWriter

folder, part_bytes, count, limit = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
writer = BagWriter(folder, "uav1", 96 << 20, part_bytes)

def message(data, latching):
    m, buffer = rospy.AnyMsg(), io.BytesIO()
    String(data).serialize(buffer)
    m._buff = buffer.getvalue()
    m._connection_header = {"type": String._type, "md5sum": String._md5sum, "message_definition": String._full_text,
                            "latching": latching, "callerid": "/feed"}
    return m

writer.put("/tf_static", message("fixed", "1"), genpy.Time(1))
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
for i in range(count):
    writer.put("/a", message(f"{i} " + "x" * 20_000, "0"), genpy.Time(100 + i // 100, i % 100 * 10_000_000))
    print(i, time.time(), writer.path.name, writer.problem, flush=True)
    time.sleep(0.01)
closed = writer.close()
print("closed", closed, writer.problem, writer.dropped, flush=True)
"""


@pytest.fixture
def write(tmp_path):
    """write(part_bytes=, count=, limit=) -> a process that records into tmp_path."""
    started = []

    def start(part_bytes=1 << 31, count=10_000, limit=0):
        command = [
            sys.executable,
            "-c",
            WRITER,
            str(tmp_path),
            *map(str, (part_bytes, count, limit)),
        ]
        with (tmp_path / "said").open("w") as said:
            started.append(subprocess.Popen(command, stdout=said))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


def said(folder):
    return [
        line.split(" ")
        for line in (folder / "said").read_text().splitlines()
        if line.count(" ") >= 3
    ]


def numbers(path):
    with rosbag.Bag(str(path)) as bag:
        return [int(m.data.split(" ")[0]) for _, m, _ in bag.read_messages("/a")]


def latched(path):
    with rosbag.Bag(str(path)) as bag:
        return [m.data for _, m, _ in bag.read_messages("/tf_static")]


def test_killed_at_most_a_second_is_lost_and_the_next_one_begins_a_new_part(write, tmp_path):
    process = write()
    until(lambda: len(said(tmp_path)) > 150)
    with pytest.raises(BagError, match="is being recorded now"):
        check(tmp_path / "uav1.bag.active")
    process.send_signal(signal.SIGKILL)
    process.wait()
    killed_s, lines = time.time(), said(tmp_path)
    assert begin(tmp_path, "uav1.bag", killed_s) == (1, [])

    process = write(count=20)
    until(lambda: process.poll() is not None)
    assert lines[-1][2] == "uav1.bag" and said(tmp_path)[0][2] == "uav1.1.bag"
    assert (
        numbers(tmp_path / "uav1.1.bag") == list(range(20))
        and (tmp_path / "uav1.bag.active").exists()
    )

    path, salvaged = repaired(tmp_path / "uav1.bag.active")
    kept = numbers(path)
    assert kept == list(range(len(kept))) and salvaged.topics["/a"] == len(kept)
    lost_s = [float(when) for number, when, *_ in lines if int(number) >= len(kept)]
    assert not lost_s or killed_s - lost_s[0] <= 1.0


def test_split_by_size_every_part_is_whole_and_has_what_is_latched(write, tmp_path):
    process = write(part_bytes=2 << 20, count=400)
    until(lambda: process.poll() is not None)
    parts = parts_in(tmp_path, "uav1.bag")
    assert [p.name for p in parts] == ["uav1.bag", "uav1.1.bag", "uav1.2.bag", "uav1.3.bag"]
    assert [n for p in parts for n in numbers(p)] == list(range(400))
    for part in parts:
        assert check(part) and latched(part) == ["fixed"] and part.stat().st_size < 3 << 20
    assert (tmp_path / "said").read_text().splitlines()[-1] == "closed True  0"


def test_a_disk_that_refuses_is_told_and_what_is_written_can_be_repaired(write, tmp_path):
    """The kernel's limit of a file's size stands for a disk that has no more room."""
    process = write(count=300, limit=3 << 20)
    until(lambda: process.poll() is not None)
    assert process.returncode == 0
    last = (tmp_path / "said").read_text().splitlines()[-1]
    assert (
        last.startswith("closed False")
        and "uav1.bag.active: File too large; make room and start again" in last
    )
    assert int(last.split(" ")[-1]) > 50, "what is not written is counted"
    path, salvaged = repaired(tmp_path / "uav1.bag.active")
    kept = numbers(path)
    assert (
        kept == list(range(len(kept)))
        and 100 < len(kept) < 160
        and salvaged.topics["/a"] == len(kept)
    )


class Disk:
    """In place of os.fsync: what a power cut leaves of a file is what it held when the last call
    for it began."""

    def __init__(self, takes_s):
        self._fsync, self._takes_s, self.synced = os.fsync, takes_s, []

    def fsync(self, descriptor):
        size = os.fstat(descriptor).st_size
        time.sleep(self._takes_s)
        self._fsync(descriptor)
        self.synced.append((time.monotonic(), size))


def numbered(number):
    message, buffer = rospy.AnyMsg(), io.BytesIO()
    String(f"{number} " + "x" * 2000).serialize(buffer)
    message._buff = buffer.getvalue()
    message._connection_header = {
        "type": String._type,
        "md5sum": String._md5sum,
        "message_definition": String._full_text,
    }
    return message


@pytest.mark.parametrize("takes_s", [0.0, 0.3])
def test_at_a_power_cut_at_most_a_second_is_lost(tmp_path, monkeypatch, takes_s):
    """Cut at any moment: just before the next call to the disk is over most is lost."""
    disk, put_s = Disk(takes_s), []
    monkeypatch.setattr(os, "fsync", disk.fsync)
    writer = BagWriter(tmp_path, "uav1", 96 << 20, 1 << 31)
    for number in range(130):
        put_s.append(time.monotonic())
        assert writer.put("/a", numbered(number), genpy.Time(100 + number))
        time.sleep(0.01)
    content, calls = (tmp_path / "uav1.bag.active").read_bytes(), list(disk.synced)
    writer.close()
    files = [call for call in calls if call[1] > 0]
    assert len(files) >= 3
    kept = {}
    for i, (_, size) in enumerate(files):
        cut = tmp_path / f"cut{i}.bag"
        cut.write_bytes(content[:size])
        try:
            kept[i] = numbers(repaired(cut)[0])
        except BagError as error:  # the first call may find no message
            assert i == 0 and "no whole message" in str(error)
            kept[i] = []
        assert kept[i] == list(range(len(kept[i])))
    for i, (cut_s, _) in enumerate(files):
        oldest_lost_s = put_s[len(kept[i - 1]) if i else 0]
        assert cut_s - oldest_lost_s <= 1.0, (
            f"{cut_s - oldest_lost_s:.2f} s lost at {cut_s - put_s[0]:.2f} s"
        )


def test_a_new_part_and_a_closed_bag_stand_in_their_folder_after_a_power_cut(tmp_path, monkeypatch):
    """A file's name is on the disk once its folder was written, too."""
    folders, fsync = [], os.fsync

    def told(descriptor):
        if os.path.isdir(f"/proc/self/fd/{descriptor}"):
            folders.append(sorted(p.name for p in tmp_path.iterdir()))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", told)
    writer = BagWriter(tmp_path, "uav1", 96 << 20, 1 << 31)
    writer.put("/a", numbered(0), genpy.Time(100))
    assert writer.close()
    assert folders == [["uav1.bag.active"], ["uav1.bag"]]
