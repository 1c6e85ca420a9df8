# SPDX-License-Identifier: Apache-2.0
"""Where nothing can be written is said before the work, in a sentence."""

import argparse
import errno
import os
import shutil
import subprocess
import sys
from collections import namedtuple

import pytest

from fcsv_geometry.programs import commands, writing
from fcsv_geometry.programs.writing import OutputPlaceError, in_words, require_file, require_folder

_Usage = namedtuple("_Usage", "total used free")


def test_a_folder_that_can_be_made_is_taken_and_not_made(tmp_path):
    require_folder(tmp_path / "a" / "b")
    require_file(tmp_path / "a" / "b.json")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("below", ["", "deeper/still"])
def test_a_file_in_the_way_is_named(below, tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OutputPlaceError, match="out: a file stands there"):
        require_folder(tmp_path / "out" / below)


def test_a_command_that_the_system_stops_says_where_it_wrote(capsys):
    """The first of the arguments that name it and are given; an error that names its own file keeps
    it."""
    parser = argparse.ArgumentParser(prog="draw")
    for name in ("--trace", "--json"):
        parser.add_argument(name)
    full = OSError(errno.ENOSPC, "No space left on device")

    def end(error, *argv):
        assert (
            commands.run(parser, list(argv), lambda _args: raised(error), writes=("trace", "json"))
            == 2
        )
        return capsys.readouterr().err

    def raised(error):
        raise error

    assert (
        end(full, "--json", "a.json")
        == "draw: a.json: the disk is full: make room, or choose another folder\n"
    )
    assert end(full) == "draw: the disk is full: make room, or choose another folder\n"
    assert "draw: b: does not exist" in end(
        FileNotFoundError(errno.ENOENT, "", "b"), "--trace", "a.png"
    )


def test_a_folder_in_place_of_a_file_is_named(tmp_path):
    with pytest.raises(OutputPlaceError, match="is a folder: name a file"):
        require_file(tmp_path)


@pytest.mark.parametrize(
    "number, words",
    [
        (errno.EACCES, "this user may not write here"),
        (errno.EROFS, "read-only"),
        (errno.ENOSPC, "the disk is full"),
    ],
)
def test_what_the_system_refuses_is_a_sentence(number, words, tmp_path, monkeypatch):
    def refuse(**_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(writing.tempfile, "TemporaryFile", refuse)
    with pytest.raises(OutputPlaceError, match=words) as told:
        require_folder(tmp_path)
    assert str(told.value).startswith(f"{tmp_path}: ") and "\n" not in str(told.value)


def test_too_little_room_is_said_with_both_figures(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: _Usage(1 << 40, 1 << 40, 5 << 20))
    require_folder(tmp_path, 5)
    with pytest.raises(OutputPlaceError, match="5 MiB are free, 6 are needed"):
        require_folder(tmp_path, 6)


def test_an_error_without_a_number_on_a_full_disk_is_a_full_disk(tmp_path, monkeypatch):
    short = OSError("640 requested and 12 written")  # as numpy tells it
    assert in_words(short, tmp_path) == f"{tmp_path}: 640 requested and 12 written"
    monkeypatch.setattr(shutil, "disk_usage", lambda _: _Usage(1 << 40, 1 << 40, 0))
    assert "the disk is full" in in_words(short, tmp_path)


def test_ctrl_c_while_a_command_is_loaded_is_one_line_and_later_an_interrupt(tmp_path):
    script = """
import os, signal, sys, time
from fcsv_geometry.programs.commands import loading
signal.signal(signal.SIGINT, signal.SIG_IGN if "ignored" in sys.argv else signal.default_int_handler)
before = signal.getsignal(signal.SIGINT)
with loading("map"):
    if "early" in sys.argv:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.2)
assert signal.getsignal(signal.SIGINT) is before
"""
    run = lambda *argv: subprocess.run(  # noqa: E731
        [sys.executable, "-c", script, *argv], capture_output=True, text=True
    )
    done = run("early")
    assert (done.returncode, done.stderr) == (130, "map: interrupted; nothing was begun\n")
    for argv in ((), ("early", "ignored")):
        done = run(*argv)
        assert (done.returncode, done.stderr) == (0, "")


def test_a_read_only_disk_is_said_of_the_folder_not_of_what_was_tried_there(tmp_path, monkeypatch):
    def refuse(dir):
        raise OSError(errno.EROFS, "Read-only file system", f"{dir}/tmpx")

    monkeypatch.setattr(writing.tempfile, "TemporaryFile", refuse)
    with pytest.raises(
        OutputPlaceError, match=f"^{tmp_path}: the disk is read-only: choose another folder$"
    ):
        require_folder(tmp_path / "out")
