# SPDX-License-Identifier: Apache-2.0
"""Reported folders of photographs, and the same kinds drawn here: read right, or refused by
name."""

import struct
import unicodedata

import cv2
import numpy as np
import pytest
import tifffile
from support.spoilt_pictures import BREAKS, HEIC, grain, spoil, with_orientation

from fcsv_geometry import transforms
from fcsv_geometry.picture_files import read_picture
from fcsv_stereo.errors import InputError
from fcsv_stereo.joint import JointOptions
from fcsv_stereo.photos.pictures import copy_upright, upright_size
from fcsv_stereo.photos.tags import read_tags
from fcsv_stereo.pipeline import METHODS, load
from fcsv_stereo.posed import colmap
from fcsv_stereo.posed.posed_pictures import load_pictures

NAMES = [f"uav2_h{n}.png" for n in (2, 4, 6, 8)]


def poses(given):
    pictures = [given.configurations[0].references[0], *(c.others[0] for c in given.configurations)]
    return {p.name: p.T_home_cam for p in pictures}


def refused(folder, reference=None):
    with pytest.raises(InputError) as error:
        load(folder, reference)
    assert "\n" not in str(error.value) and str(folder) in str(error.value)
    return str(error.value)


def test_reported_no_second_lines(shared_data):
    folder = shared_data / "reports" / "photos_subfolder_no_second_lines"
    for reference in ("cam1/uav1_home.png", "uav1_home.png", None):
        assert set(poses(load(folder, reference))) == {
            f"cam1/{n}" for n in ("uav1_home.png", *NAMES)
        }


@pytest.mark.parametrize("name", ["photos_nfd_name", "photos_rigs_txt", "photos_utm"])
def test_reported_models_read_right(shared_data, name):
    """Poses are those of the same pictures in the folder that has no fault but its missing
    lines."""
    reports = shared_data / "reports"
    right = poses(load(reports / "photos_subfolder_no_second_lines"))
    given = load(reports / name)
    found = list(poses(given).values())
    for T, of in zip(found, ("uav1_home.png", "uav2_h4.png", "uav2_h8.png")):
        assert np.allclose(T, right[f"cam1/{of}"], atol=2e-5)  # 12 digits at 5800 km
    assert bool(given.warnings) == (name == "photos_rigs_txt")
    assert given.origin_m.tolist() == (
        [389000.0, 5819000.0, 0.0] if name == "photos_utm" else [0.0, 0.0, 0.0]
    )


@pytest.mark.slow
def test_reported_models_map_alike(shared_data):
    """The same three pictures under another name, with stale poses beside the right ones, and in
    UTM, where 12 digits are 6 micrometres: priors that were off by so much gave 1.9 % other pixels
    and depths 1.5 % off (99 %)."""
    depths = []
    for name in ("photos_nfd_name", "photos_rigs_txt", "photos_utm"):
        given = load(shared_data / "reports" / name)
        depths.append(METHODS["joint"].map(given, JointOptions(), lambda *_: None).depth)
    for depth in depths[1:]:
        both = np.isfinite(depth) & np.isfinite(depths[0])
        assert both.sum() > 0.96 * max(np.isfinite(d).sum() for d in (depth, depths[0])) > 2000
        assert np.percentile(np.abs(depth[both] / depths[0][both] - 1.0), 99) < 0.03


def test_reported_twice_and_cut(shared_data):
    message = refused(shared_data / "reports" / "photos_name_twice")
    assert "images.txt, line 8: uav2_h4.png stands there already, in line 4" in message
    assert "uav2_h4.jpg: ends in the middle" in refused(shared_data / "reports" / "photos_jpeg_cut")


POSE = "{id} 1 0 0 0 {x} 0 0 1 {name}"


def several(
    folder, names=("a.png", "b.png", "c.png"), between="\n\n", end="\n\n", head="# Image list\n"
):
    """A model of black pictures in a row, its images.txt written in some way."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    (folder / "cameras.txt").write_text("1 PINHOLE 64 48 60 60 32 24\n")
    lines = [POSE.format(id=i + 1, x=-i, name=n) for i, n in enumerate(names)]
    (folder / "images.txt").write_bytes((head + between.join(lines) + end).encode())
    for name in names:
        path = folder / "images" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.zeros((48, 64, 3), np.uint8))
    return folder


@pytest.mark.parametrize(
    "given, ways",
    [
        ("images.txt without second lines", {"between": "\n", "end": "\n"}),
        ("images.txt, the last line without an end", {"between": "\n", "end": ""}),
        ("images.txt with doubled blank lines", {"between": "\n\n\n\n"}),
        ("images.txt with three blank lines", {"between": "\n\n\n"}),
        ("images.txt with blank lines before", {"head": "\n\n# x\n\n"}),
        ("images.txt with points", {"between": "\n1.5 2.5 -1 3.0 4.0 17\n"}),
        (
            "images.txt with points, every line end doubled",
            {"between": "\n\n1.5 2.5 -1 3.0 4.0 17\n\n"},
        ),
        ("images.txt with comments between", {"between": "\n\n# next\n  # and one more\n"}),
        (
            "images.txt with CRLF",
            {"between": "\r\n\r\n", "end": "\r\n\r\n", "head": "# Image list\r\n"},
        ),
        ("images.txt with CRLF, without second lines", {"between": "\r\n", "end": "\r\n"}),
        ("images.txt with a byte order mark", {"head": "\ufeff# Image list\n"}),
        ("images.txt with blanks at line ends", {"between": "  \n  \n"}),
        ("names with two blanks in a row", {"names": ("DJI  1.png", "DJI  2.png", "DJI 2.png")}),
        ("names with a comma", {"names": ("DJI, 1.png", "DJI, 2.png", "c.png")}),
        ("names of numbers alone", {"names": ("0001", "0002", "0003"), "between": "\n"}),
        (
            "names in folders",
            {"names": ("cam1/a.png", "cam2/a.png", "cam2/b.png"), "between": "\n"},
        ),
    ],
)
def test_ways_to_write_images_txt(tmp_path, given, ways, wrong_input):
    if ways.get("names", ("",))[0] == "0001":
        several(tmp_path / "m", ("a.png", "b.png", "c.png"))
        for old, new in zip("abc", ways["names"]):
            (tmp_path / "m" / "images" / f"{old}.png").rename(tmp_path / "m" / "images" / new)
        text = (tmp_path / "m" / "images.txt").read_text()
        for old, new in zip("abc", ways["names"]):
            text = text.replace(f"{old}.png", new)
        (tmp_path / "m" / "images.txt").write_text(text.replace("\n\n", "\n"))
    else:
        several(tmp_path / "m", **ways)
    found = poses(load(tmp_path / "m"))
    assert list(found) == list(ways.get("names", ("a.png", "b.png", "c.png")))
    assert [T[0, 3] for T in found.values()] == [0.0, 1.0, 2.0]
    wrong_input("COLMAP models", given, "read right")


@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_names_composed_and_decomposed(tmp_path, form, wrong_input):
    """Both ways, and in priors.csv, too."""
    forms = (form, "NFD" if form == "NFC" else "NFC")
    name, other = (unicodedata.normalize(f, "Gr\u00f6\u00dfe \u00e9.png") for f in forms)
    folder = several(tmp_path, ("a.png", name))
    (folder / "images" / name).rename(folder / "images" / other)
    (folder / "priors.csv").write_text(
        PRIORS + "\n".join(f"{n},1,1,1,1,1,1" for n in ("a.png", other))
    )
    assert list(poses(load(folder))) == ["a.png", name]
    wrong_input("COLMAP models", "file names decomposed by macOS", "read right")


PRIORS = "name,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg\n"


@pytest.mark.parametrize("quote", ["", '"'])
def test_priors_of_names_with_commas(tmp_path, quote, wrong_input):
    names = ("DJI, 1.png", "DJI, 2.png")
    folder = several(tmp_path, names)
    (folder / "priors.csv").write_text(
        PRIORS + "".join(f"{quote}{n}{quote},1,2,3,1,1,1\n" for n in names)
    )
    (c,) = load(folder).configurations
    assert np.allclose(np.diag(c.others[0].covariance)[:3], [1, 4, 9])
    wrong_input("COLMAP models", "priors.csv, a name with a comma", "read right")


@pytest.mark.parametrize("on_disk", ["cam1/A.PNG", "cam1/a.PNG"])
def test_names_of_windows(tmp_path, on_disk, wrong_input):
    folder = several(tmp_path, ("c.png", on_disk))
    text = (folder / "images.txt").read_text()
    (folder / "images.txt").write_text(text.replace(on_disk, "cam1\\a.png"))
    assert len(poses(load(folder))) == 2
    wrong_input("COLMAP models", "names with backslashes or other capital letters", "read right")


def _append(file, line):
    def append(folder):
        with (folder / file).open("a") as opened:
            opened.write(line)

    return append


@pytest.mark.parametrize(
    "given, spoil_it, words",
    [
        (
            "a name twice in images.txt",
            _append("images.txt", "9 1 0 0 0 -1 0 0 1 b.png\n\n"),
            "line 8: b.png stands",
        ),
        (
            "a name twice, written otherwise",
            _append("images.txt", "9 1 0 0 0 -1 0 0 1 ./b.png\n\n"),
            "line 8: ./b.png",
        ),
        (
            "a camera twice in cameras.txt",
            _append("cameras.txt", "1 PINHOLE 64 48 70 70 32 24\n"),
            "line 2: camera 1",
        ),
        (
            "a pose line that is cut",
            _append("images.txt", "9 1 0 0 0 -1"),
            "images.txt, line 8: not a posed picture",
        ),
        (
            "a pose line that is no number",
            _append("images.txt", "9 1 0 x 0 -1 0 0 1 d.png\n"),
            "images.txt, line 8",
        ),
        (
            "a photograph in a folder without a pose",
            lambda f: several(f / "images", ("d.png",)),
            "has no pose",
        ),
        (
            "frames.txt without rigs.txt",
            _append("frames.txt", "1 1 1 0 0 0 0 0 0 1 CAMERA 1 1\n"),
            "rigs.txt is missing",
        ),
    ],
)
def test_what_is_refused_by_line(tmp_path, given, spoil_it, words, wrong_input):
    folder = several(tmp_path / "m")
    spoil_it(folder)
    message = refused(folder)
    assert words in message
    wrong_input("COLMAP models", given, "refused", message.split(" (")[0])


def test_hints_of_where_files_are(tmp_path):
    """COLMAP's own folders, and names that begin with the folder."""
    folder = several(tmp_path / "a")
    (folder / "sparse" / "0").mkdir(parents=True)
    for name in ("cameras.txt", "images.txt"):
        (folder / name).rename(folder / "sparse" / "0" / name)
    assert "copy what stands in " in refused(folder) and "sparse/0 beside images/" in refused(
        folder
    )
    folder = several(tmp_path / "b")
    (folder / "images.txt").write_text(
        (folder / "images.txt").read_text().replace("b.png", "images/b.png")
    )
    assert "is missing; images.txt names it; " in refused(folder) and "name it 'b.png'" in refused(
        folder
    )


def test_what_systems_leave_beside_pictures_is_passed_over(tmp_path):
    folder = several(tmp_path)
    for name in ("._a.png", ".DS_Store", "@eaDir/a.png", "__MACOSX/a.png", "Thumbs.db"):
        (folder / "images" / name).parent.mkdir(exist_ok=True)
        (folder / "images" / name).write_bytes(b"1")
    assert len(poses(load(folder))) == 3


T_CAM_RIG = transforms.from_xyz_rpy([0.2, -0.1, 0.05], [0.02, 0.3, -0.01])
T_RIG_HOME = [transforms.from_xyz_rpy([-i, 0.1 * i, 0.0], [0.01 * i, 0.0, 0.02]) for i in range(2)]


def numbers(T):
    x, y, z, w = transforms.quaternion_xyzw(T)
    return " ".join(repr(float(v)) for v in (w, x, y, z, *T[:3, 3]))


def rig(folder, stale, cameras=(1, 2)):
    """Two frames of a rig of two cameras; ``stale``: images.txt has the rig's poses instead of the
    cameras'."""
    several(folder, ("l0.png", "r0.png", "l1.png", "r1.png"))
    (folder / "cameras.txt").write_text(
        "".join(f"{c} PINHOLE 64 48 60 60 32 24\n" for c in cameras)
    )
    (folder / "rigs.txt").write_text(f"# Rigs\n1 2 CAMERA 1 CAMERA 2 1 {numbers(T_CAM_RIG)}\n")
    frames, images = ["  # Frames"], []
    for i, T in enumerate(T_RIG_HOME):
        frames.append(f"{i + 1} 1 {numbers(T)} 2 CAMERA 1 {2 * i + 1} CAMERA 2 {2 * i + 2}")
        images.append(f"{2 * i + 1} {numbers(T)} 1 l{i}.png\n")
        images.append(f"{2 * i + 2} {numbers(T if stale else T_CAM_RIG @ T)} 2 r{i}.png\n")
    (folder / "frames.txt").write_text("\n".join(frames) + "\n")
    (folder / "images.txt").write_text("\n".join(images))
    return folder


@pytest.mark.parametrize("stale", [True, False])
def test_rigs_and_frames_are_composed(tmp_path, stale, wrong_input):
    given = load(rig(tmp_path, stale))
    found = poses(given)
    for i, T in enumerate(T_RIG_HOME):
        assert np.allclose(found[f"l{i}.png"], transforms.invert(T), atol=1e-9)
        assert np.allclose(found[f"r{i}.png"], transforms.invert(T_CAM_RIG @ T), atol=1e-9)
    assert len(given.warnings) == stale
    if stale:
        assert "contradicts rigs.txt and frames.txt about 2 of 4 pictures" in given.warnings[0]
        wrong_input(
            "COLMAP models",
            "images.txt older than frames.txt",
            "read, with a warning",
            given.warnings[0],
        )
    else:
        wrong_input("COLMAP models", "rigs.txt and frames.txt (COLMAP 3.12 on)", "read right")


@pytest.mark.parametrize(
    "file, old, new, words",
    [
        ("frames.txt", "CAMERA 2 4", "CAMERA 2 9", "image 4 (r1.png) is in no frame"),
        (
            "frames.txt",
            "CAMERA 2 4",
            "CAMERA 1 4",
            "frames.txt, line 3: image 4 (r1.png) is of camera 1",
        ),
        ("frames.txt", "CAMERA 2 4", "CAMERA 2", "frames.txt, line 3: not a frame"),
        ("frames.txt", "CAMERA 2 4", "CAMERA 2 3", "image 3 is in a frame already"),
        ("rigs.txt", "CAMERA 2 1", "CAMERA 2 0", "rigs.txt, line 2: not a rig"),
        ("rigs.txt", "1 2 CAMERA 1", "1 3 CAMERA 1", "rigs.txt, line 2: not a rig"),
        (
            "rigs.txt",
            "1 2 CAMERA 1 CAMERA 2",
            "1 2 CAMERA 1 CAMERA 7",
            "camera 2 has no pose in rig 1",
        ),
    ],
)
def test_wrong_rigs_are_refused(tmp_path, file, old, new, words):
    path = rig(tmp_path / "m", True) / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    assert words in refused(tmp_path / "m")


def test_frames_without_lines_say_nothing(tmp_path):
    folder = rig(tmp_path, False)
    (folder / "frames.txt").write_text("# Frame list\n# Number of frames: 0\n")
    (folder / "rigs.txt").write_text("# none\n")
    given = load(folder)
    assert (
        np.allclose(poses(given)["r1.png"], transforms.invert(T_CAM_RIG @ T_RIG_HOME[1]))
        and not given.warnings
    )


def photographs(folder, count=3, suffix=".jpg"):
    names = [f"{c}{suffix}" for c in "abcde"[:count]]
    several(folder, names)
    whole = cv2.imencode(suffix, grain((48, 64)))[1].tobytes()
    if suffix == ".jpg":
        whole = with_orientation(whole, 1, cv2.imencode(".jpg", grain((24, 32)))[1].tobytes())
    for name in names:
        (folder / "images" / name).write_bytes(whole)
    return folder, whole


@pytest.mark.parametrize("how", [*BREAKS, "HEIC"])
def test_one_broken_of_three_is_left_out_and_named(tmp_path, how, wrong_input):
    folder, whole = photographs(tmp_path / "m")
    (folder / "images" / "b.jpg").write_bytes(HEIC if how == "HEIC" else spoil(whole, how))
    given = load(folder)
    assert list(poses(given)) == ["a.jpg", "c.jpg"]
    (message,) = given.warnings
    assert message.startswith("left out: ") and "b.jpg: " in message
    if how == "cut at 50 %":
        wrong_input(
            "Pictures",
            "one of several photographs cut",
            "left out and named",
            message.split(" (")[0],
        )


def test_import_tells_what_is_no_photograph(tmp_path):
    for name, data, words in (
        ("a.jpg", HEIC, "is HEIC"),
        ("b.jpg", b"", "cannot be read"),
        ("c.jpg", b"x" * 99, "cannot be read"),
    ):
        folder = tmp_path / name[0]
        folder.mkdir()
        (folder / name).write_bytes(data)
        with pytest.raises(InputError, match=f"{name}: {words}"):
            read_tags(folder / name)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_import_turns_tiff_once(tmp_path, orientation):
    """Pillow turns TIFF as it reads it, and says the size of the turned picture."""
    (tmp_path / "to").mkdir()
    image = grain((32, 48))
    tifffile.imwrite(tmp_path / "a.tif", image, extratags=[(274, "H", 1, orientation, True)])
    tags = read_tags(tmp_path / "a.tif")
    assert tags.size == (48, 32) and tags.orientation == orientation
    if orientation in (2, 4, 5, 7):
        return  # mirrored ones are refused
    copy_upright(tags, tmp_path / "to", 0)
    found, stored = (read_picture(tmp_path / folder / "a.tif") for folder in ("to", "."))
    assert found.orientation == 1 and np.array_equal(found.pixels, stored.turned())
    assert upright_size(tags, 0) == found.size


@pytest.mark.parametrize("how", BREAKS)
def test_import_refuses_what_is_broken(tmp_path, how):
    """Also where the file would be copied as it is."""
    _, whole = photographs(tmp_path / "m", 2)
    (tmp_path / "x.jpg").write_bytes(whole)
    tags = read_tags(tmp_path / "x.jpg")
    (tmp_path / "x.jpg").write_bytes(spoil(whole, how))
    (tmp_path / "to").mkdir()
    with pytest.raises(InputError, match="x.jpg: "):
        copy_upright(tags, tmp_path / "to", 0)


def test_a_broken_reference_is_refused(tmp_path, wrong_input):
    folder, whole = photographs(tmp_path / "m")
    (folder / "images" / "a.jpg").write_bytes(spoil(whole, "cut at 50 %"))
    message = refused(folder)
    assert "a.jpg: ends in the middle" in message and "--reference" in message
    assert list(poses(load(folder, "c.jpg"))) == ["c.jpg", "b.jpg"]
    wrong_input("Pictures", "the reference photograph cut", "refused", message)


def oriented(folder, orientations, camera=(64, 48), stored=(64, 48)):
    """Pictures bright in the upper half as stored, with these EXIF orientations."""
    names = [f"{c}.jpg" for c in "abcde"[: len(orientations)]]
    several(folder, names)
    (folder / "cameras.txt").write_text(f"1 PINHOLE {camera[0]} {camera[1]} 60 60 32 24\n")
    image = np.zeros((stored[1], stored[0], 3), np.uint8)
    image[: stored[1] // 2] = 255
    for name, orientation in zip(names, orientations):
        data = cv2.imencode(".jpg", image)[1].tobytes()
        (folder / "images" / name).write_bytes(with_orientation(data, orientation))
    return folder


def is_stored(picture):
    return picture[:10].mean() > 200 > 50 > picture[-10:].mean()


def test_orientation_that_the_size_does_not_tell(tmp_path, wrong_input):
    """Half turns alone: stored, and said. Where other pictures' size tells that the model is of
    turned ones: turned."""
    given = load(oriented(tmp_path / "a", (1, 3, 3)))
    images = [
        given.configurations[0].references[0].image,
        *(c.others[0].image for c in given.configurations),
    ]
    assert all(map(is_stored, images)) and "turns 2 of 3 pictures" in given.warnings[0]
    wrong_input(
        "Pictures",
        "EXIF orientation 3 of a model's pictures",
        "read, with a warning",
        given.warnings[0],
    )
    square = load(oriented(tmp_path / "b", (6, 6), (64, 64), (64, 64)))
    assert is_stored(square.configurations[0].others[0].image) and square.warnings
    folder = oriented(tmp_path / "c", (6, 6, 3), (48, 64), (64, 48))  # stored lying, shown upright
    (folder / "cameras.txt").write_text(
        "1 PINHOLE 48 64 60 60 24 32\n2 PINHOLE 64 48 60 60 32 24\n"
    )
    text = (folder / "images.txt").read_text().replace("1 c.jpg", "2 c.jpg")
    (folder / "images.txt").write_text(text)
    cameras, warnings = colmap.read_cameras(folder / "cameras.txt"), []
    posed = colmap.read_images(folder / "images.txt", cameras)
    files = {p.name: folder / "images" / p.name for p in posed}
    found = load_pictures(files, posed, cameras, "a.jpg", warnings)
    assert not is_stored(found["c.jpg"].image) and not warnings
    wrong_input("Pictures", "EXIF orientation 6, a model of turned pixels", "read right")


def test_binary_model_beside_the_text(tmp_path, wrong_input):
    """The same is no matter; another one is refused."""
    folder = several(tmp_path / "m", ("a.png", "b.png"))

    def binary(x):
        (folder / "cameras.bin").write_bytes(
            struct.pack("<QiiQQ4d", 1, 1, 1, 64, 48, 60, 60, 32, 24)
        )
        images = [
            struct.pack("<i7di", i + 1, 1, 0, 0, 0, -i * x, 0, 0, 1)
            + n
            + b"\0"
            + struct.pack("<Q", 0)
            for i, n in enumerate((b"a.png", b"b.png"))
        ]
        (folder / "images.bin").write_bytes(struct.pack("<Q", 2) + b"".join(images))

    binary(1.0)
    assert len(poses(load(folder))) == 2
    binary(2.0)
    message = refused(folder)
    assert "images.bin: has another pose of b.png" in message
    wrong_input(
        "COLMAP models", "images.bin beside images.txt with other poses", "refused", message
    )
    (folder / "images.txt").unlink()
    assert "model_converter" in refused(folder)


def test_rounded_quaternions_far_from_the_origin(tmp_path, wrong_input):
    """Six digits at 5800 km are metres; at home they are nothing."""
    T = [
        transforms.from_xyz_rpy([389000.0 + i, 5819000.0, 40.0], [0.1, 0.2, 0.3 + 0.01 * i])
        for i in range(2)
    ]
    for shift, ok in ((0.0, False), (5819000.0, True)):
        folder = several(tmp_path / f"m{ok}", ("a.png", "b.png"))
        lines = []
        for i, pose in enumerate(T):
            near = pose.copy()
            near[:3, 3] -= [389000.0 * ok, shift, 40.0 * ok]
            six = " ".join(f"{float(v):.6f}" for v in numbers(transforms.invert(near)).split())
            lines.append(f"{i + 1} {six} 1 ")
        (folder / "images.txt").write_text(
            "".join(f"{s}{n}\n\n" for s, n in zip(lines, ("a.png", "b.png")))
        )
        if ok:
            assert len(poses(load(folder))) == 2
        else:
            message = refused(folder)
            assert "more digits" in message
            wrong_input(
                "COLMAP models",
                "UTM with quaternions of six digits",
                "refused",
                message.split(" that ")[0],
            )
