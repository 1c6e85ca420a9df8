# SPDX-License-Identifier: Apache-2.0
"""GPS-tagged photographs of 64 x 48 px and a model of their poses, whose truth is known; the test
spoils tags."""

from dataclasses import dataclass, field
from typing import Callable, Dict, List, Optional

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin
from scipy.spatial.transform import Rotation

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import InputError
from fcsv_stereo.photos import ImportOptions, import_photos
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.photos.models import write_model
from fcsv_stereo.posed import colmap
from support.gps_tags import gps_at

AREA = "Photographs with GPS"  # of the table of wrong inputs
SIZE = (64, 48)
SCALE = 10.0  # m per unit of the model
ORIGIN = Gps(48.0, 11.0, 560.0)
_NED_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_R_BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass
class Photo:
    """What is written of one photograph: EXIF's GPS tags by number, DJI's XMP by name."""

    name: str
    enu_m: np.ndarray
    angles_deg: np.ndarray
    exif_gps: Dict[int, object] = field(default_factory=dict)
    xmp: Dict[str, str] = field(default_factory=dict)
    orientation: int = 1


def block(
    columns: int = 5, rows: int = 2, nadir: bool = True, sigma_m: float = 0.3, seed: int = 3
) -> List[Photo]:
    """Rows of photographs, 15 m apart, in rows 40 m apart, flown east and back; tags as of a good
    receiver."""
    rng = np.random.default_rng(seed)
    photos = []
    for i in range(columns * rows):
        row, column = divmod(i, columns)
        enu = np.array([15.0 * column, 40.0 * row, 0.0]) + rng.normal(0, [1.0, 1.0, 1.0])
        angles = np.array([180.0 * (row % 2), -90.0 if nadir else -40.0, 0.0]) + rng.normal(
            0, [2.0, 1.0, 0.5]
        )
        photo = Photo(f"DJI_{i:04}.JPG", enu, angles)
        photo.exif_gps = exif_gps(gps_at(enu + rng.normal(0, sigma_m, 3), ORIGIN), sigma_m)
        photos.append(photo)
    return photos


def exif_gps(gps: Gps, sigma_m: Optional[float] = None) -> Dict[int, object]:
    tags = {
        1: "NS"[int(gps.latitude_deg < 0)],
        2: sexagesimal(gps.latitude_deg),
        3: "EW"[int(gps.longitude_deg < 0)],
        4: sexagesimal(gps.longitude_deg),
        5: bytes([int(gps.height_m < 0)]),
        6: ratio(abs(gps.height_m), 1000),
    }
    return {**tags, 31: ratio(sigma_m, 1000)} if sigma_m else tags


def sexagesimal(degrees: float, of: int = 1000000) -> tuple:
    """``of``: parts of a second that are written."""
    seconds = round(abs(degrees) * 3600 * of)
    return (
        ratio(seconds // (3600 * of), 1),
        ratio(seconds // (60 * of) % 60, 1),
        ratio(seconds % (60 * of) / of, of),
    )


def ratio(value: float, of: int):
    return TiffImagePlugin.IFDRational(round(value * of), of)


def with_angles(photos: List[Photo]) -> List[Photo]:
    """The same with gimbal angles, right to 0.5 degrees."""
    rng = np.random.default_rng(5)
    for p in photos:
        for name, value in zip(("Yaw", "Pitch", "Roll"), p.angles_deg + rng.normal(0, 0.5, 3)):
            p.xmp[f"Gimbal{name}Degree"] = f"{value:+.2f}"
    return photos


def R_enu_cam(photo: Photo) -> np.ndarray:
    return (
        _NED_ENU
        @ Rotation.from_euler("ZYX", photo.angles_deg, degrees=True).as_matrix()
        @ _R_BODY_OPTICAL
    )


def write(
    folder,
    photos: List[Photo],
    turned: Callable[[Photo], np.ndarray] = lambda p: np.eye(3),
    size=SIZE,
):
    """``folder`` with DCIM/ and model/. ``turned``: R_upright_cam, of the model's picture in the
    upright one."""
    R_model_enu = Rotation.from_euler("ZYX", [0.5, -0.3, 2.0]).as_matrix()
    (folder / "model").mkdir(parents=True)
    posed = []
    for p in photos:
        (folder / "DCIM" / p.name).parent.mkdir(parents=True, exist_ok=True)
        _write_photo(folder / "DCIM" / p.name, p)
        T = np.eye(4)
        T[:3, :3] = R_model_enu @ R_enu_cam(p) @ turned(p)
        T[:3, 3] = R_model_enu @ p.enu_m / SCALE + [3.0, -1.0, 2.0]
        posed.append(colmap.PosedImage(p.name, 1, T))
    write_model(
        folder / "model",
        {1: PinholeCamera(*size, 60.0, 60.0, size[0] / 2 - 0.5, size[1] / 2 - 0.5)},
        posed,
    )
    return folder


def _write_photo(path, photo: Photo) -> None:
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112] = "DJI", "X", photo.orientation
    exif.get_ifd(0x8825).update(photo.exif_gps)
    xmp = " ".join(f'drone-dji:{name}="{value}"' for name, value in photo.xmp.items())
    Image.new("RGB", SIZE).save(path, "JPEG", exif=exif, xmp=f"<rdf:Description {xmp}/>".encode())


def errors(out, photos: List[Photo]):
    """(scale's, a share; degrees from the true orientation of ENU; of that, up's) of a folder that
    was imported."""
    found = {
        p.name: p.T_home_cam
        for p in colmap.read_images(out / "images.txt", colmap.read_cameras(out / "cameras.txt"))
    }
    places = np.array([found[p.name][:3, 3] for p in photos])
    true = np.array([p.enu_m for p in photos])
    scale = (
        np.linalg.norm(places - places.mean(axis=0)) / np.linalg.norm(true - true.mean(axis=0))
        - 1.0
    )
    turn = _turn(places - places.mean(axis=0), true - true.mean(axis=0), found, photos)
    return (
        scale,
        np.degrees(Rotation.from_matrix(turn).magnitude()),
        np.degrees(np.arccos(np.clip(turn[2, 2], -1, 1))),
    )


def _turn(places, true, found, photos) -> np.ndarray:
    """R_found_true, from the axes along which the cameras look and their places."""
    looks = (
        np.array([found[p.name][:3, 2] for p in photos]),
        np.array([R_enu_cam(p)[:, 2] for p in photos]),
    )
    spread = np.linalg.norm(true)
    a, b = (
        np.vstack([p / spread, look / np.sqrt(len(photos))])
        for p, look in zip((places, true), looks)
    )
    return Rotation.align_vectors(a, b)[0].as_matrix()


def imported(folder, out):
    return import_photos(folder / "DCIM", out, ImportOptions(folder / "model"))


def require_right(folder, out, photos, scale=0.03, turn_deg=3.0):
    """The truth is within three of the standard deviations that are stated, and these are of
    use."""
    done = imported(folder, out)
    s = done.similarity
    scale_error, turned_deg, _ = errors(out, photos)
    assert abs(scale_error) < min(3.0 * s.scale_sigma, scale)
    assert turned_deg < min(
        3.0 * np.degrees(np.hypot(s.level_sigma_rad, s.north_sigma_rad)), turn_deg
    )
    return done


def refusal(folder, out) -> str:
    with pytest.raises(InputError) as raised:
        imported(folder, out)
    assert not out.exists()
    return str(raised.value)
