# SPDX-License-Identifier: Apache-2.0
"""Files with GPS as cards, phones and strangers name them: read by name and folder, or named in a
sentence."""

import unicodedata

import pytest
from support.gps_reports import AREA, block, imported, refusal, require_right, sexagesimal, write

from fcsv_stereo import fcsv_command
from fcsv_stereo.posed import colmap


@pytest.mark.parametrize(
    "name", ["DJI, {}.JPG", "DJI  {}.JPG", 'a "b" {}.JPG', "100MEDIA/DJI_{}.JPG", "#{}.jpg"]
)
def test_names(tmp_path, wrong_input, name):
    """What import_photos writes, map reads: every name as it was, each with its own sigma."""
    photos = block()
    for i, p in enumerate(photos):
        p.name = name.format(f"{i:04}")
    require_right(write(tmp_path, photos), tmp_path / "out", photos)
    given = colmap.read_photographs(tmp_path / "out", photos[3].name)
    assert {c.others[0].name for c in given.configurations} == {p.name for p in photos} - {
        photos[3].name
    }
    wrong_input(AREA, "names with a comma, two blanks, quotes, a folder", "read right")


def test_folders_of_a_card(tmp_path, wrong_input, capsys):
    """The model says DJI_0001.JPG, the card has it in 100MEDIA; of two folders nobody knows which
    is meant."""
    photos = block()
    write(tmp_path, photos)
    card = tmp_path / "DCIM" / "100MEDIA"
    card.mkdir()
    for p in photos:
        (tmp_path / "DCIM" / p.name).rename(card / p.name)
    require_right(tmp_path, tmp_path / "out", photos)
    wrong_input(AREA, "photographs in DCIM/100MEDIA", "read right")
    (tmp_path / "DCIM" / "101MEDIA").mkdir()
    (tmp_path / "DCIM" / "101MEDIA" / photos[0].name).write_bytes(
        (card / photos[0].name).read_bytes()
    )
    said = refusal(tmp_path, tmp_path / "second")
    assert "which may be 100MEDIA/DJI_0000.JPG or 101MEDIA/DJI_0000.JPG" in said
    wrong_input(AREA, "one name in two folders of the card", "refused", said)


def test_heic_that_is_called_jpg(tmp_path, wrong_input):
    write(tmp_path, block())
    (tmp_path / "DCIM" / "DJI_0003.JPG").write_bytes(b"\0\0\0\x18ftypheic" + b"\0" * 40)
    said = refusal(tmp_path, tmp_path / "out")
    assert "DJI_0003.JPG: is HEIC (iPhone), whatever its name; save it as JPEG" in said
    wrong_input(AREA, "HEIC named .JPG", "refused", said)


def test_the_command_says_what_it_left_out(tmp_path, capsys):
    photos = block()
    photos[0].exif_gps.update({2: sexagesimal(50.5), 4: sexagesimal(16.0)})
    write(tmp_path, photos)
    (tmp_path / "DCIM" / "extra.JPG").write_bytes((tmp_path / "DCIM" / photos[1].name).read_bytes())
    arguments = [
        "import-photos",
        tmp_path / "DCIM",
        "-o",
        tmp_path / "out",
        "--model",
        tmp_path / "model",
    ]
    assert fcsv_command.main([*map(str, arguments)]) == 0
    said = capsys.readouterr().out
    assert (
        "DJI_0000.JPG" in said
        and "km from the others" in said
        and "extra.JPG: left out: no pose" in said
    )


def test_letters_that_macos_has_taken_apart(tmp_path, wrong_input):
    """The model's names have an accent apart from its letter, the card's have not: the same
    photographs."""
    photos = block()
    for i, p in enumerate(photos):
        p.name = f"Pre\u0301s {i}.JPG"
    write(tmp_path, photos)
    for p in photos:
        (tmp_path / "DCIM" / p.name).rename(
            tmp_path / "DCIM" / unicodedata.normalize("NFC", p.name)
        )
    require_right(tmp_path, tmp_path / "out", photos)
    assert len(colmap.read_photographs(tmp_path / "out").configurations) == 9
    wrong_input(AREA, "names decomposed by macOS in the model", "read right")


@pytest.mark.parametrize(
    "name, words",
    [
        ("../DJI_0000.JPG", "lies outside"),
        ("DJI_0001.JPG", "DJI_0001.JPG stands there already, in line 2"),
        ("DJI_0099.JPG", "DJI_0099.JPG, which is not among the photographs"),
    ],
)
def test_names_that_no_photograph_has(tmp_path, wrong_input, name, words):
    write(tmp_path, block())
    images = tmp_path / "model" / "images.txt"
    images.write_text(images.read_text().replace("DJI_0000.JPG", name))
    said = refusal(tmp_path, tmp_path / "out")
    assert words in said
    wrong_input(
        AREA, "a model's name outside the folder, twice, or of no photograph", "refused", words
    )


def test_a_file_that_is_no_picture_and_that_no_model_needs(tmp_path, wrong_input):
    write(tmp_path, block())
    (tmp_path / "DCIM" / "torn.JPG").write_bytes(b"\0" * 100)
    done = imported(tmp_path, tmp_path / "out")
    assert done.left_out == {
        "torn.JPG": "cannot be read as a picture, it holds 100 zero octets; copy it again"
    }
    wrong_input(
        AREA,
        "a file that is no picture, without a pose",
        "left out and named",
        "cannot be read as a picture",
    )
