# SPDX-License-Identifier: Apache-2.0
"""One version in one place: VERSION; packages, wheel, programs and change log have the same."""

import re
import shutil

import pytest
import version

from fcsv_geometry.version import VERSION
from fcsv_stereo import cli, fcsv_command


def test_all_places_have_the_version_of_the_file(root):
    assert len(version.places(root)) >= 11 and not version.differing(root)
    assert version.version_of(root) == VERSION


def test_every_package_of_ours_is_a_place(root):
    packages = {p for p in root.glob("src/*/package.xml") if p.parent.name != "mavros_msgs"}
    assert packages and packages <= set(version.places(root))


def test_setting_a_version_writes_it_into_every_place(root, tmp_path, capsys):
    for path in [root / "VERSION", *version.places(root)]:
        copy = tmp_path / path.relative_to(root)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)
    assert version.main(["9.8.7"], tmp_path) == 0 and version.main(["--check"], tmp_path) == 0
    assert all("9.8.7" in p.read_text() for p in version.places(tmp_path))
    (tmp_path / "VERSION").write_text("9.9.0\n")
    assert (
        version.main(["--check"], tmp_path) == 1
        and "pyproject.toml: not 9.9.0" in capsys.readouterr().out
    )


@pytest.mark.parametrize("wrong", ["1.2", "v1.2.3", "1.2.3-rc"])
def test_what_is_no_version_is_refused(tmp_path, wrong, capsys):
    (tmp_path / "VERSION").write_text("1.0.0\n")
    with pytest.raises(SystemExit):
        version.main([wrong], tmp_path)
    assert (
        "is no MAJOR.MINOR.PATCH" in capsys.readouterr().err
        and (tmp_path / "VERSION").read_text() == "1.0.0\n"
    )


def test_the_commands_say_it(capsys):
    assert fcsv_command.main(["--version"]) == 0 and capsys.readouterr().out == f"fcsv {VERSION}\n"
    with pytest.raises(SystemExit) as ended:
        cli.main(["--version"])
    assert ended.value.code == 0 and capsys.readouterr().out == f"fcsv {VERSION}\n"


def sections(root):
    """(heading, lines of changes) of the change log, the newest first."""
    text = (root / "CHANGELOG.md").read_text()
    return [(s.split("\n")[0], re.findall(r"^- .*$", s, re.M)) for s in text.split("\n## ")[1:]]


def test_the_change_log_goes_by_version(root):
    found = sections(root)
    assert found[0][0] == "Unreleased" and VERSION in [heading for heading, _ in found]
    for heading, lines in found[1:]:
        assert re.fullmatch(r"\d+\.\d+\.\d+", heading) and 10 <= len(lines) <= 30, heading
    text = (root / "CHANGELOG.md").read_text()
    assert not [line for line in text.splitlines() if len(line) > 120]
    assert set(re.findall(r"^### (.*)$", text, re.M)) <= {"Added", "Changed", "Fixed", "Breaking"}
    assert not re.findall(r"^  \S", text, re.M)  # a change is one line
