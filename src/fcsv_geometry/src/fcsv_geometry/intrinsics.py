# SPDX-License-Identifier: Apache-2.0
"""Whether intrinsics can be a camera's: one rule for camera_info, calibration files and COLMAP.

``camera_of_matrix`` is for readers of K and D, ``require_plausible`` for readers of fx, fy, cx, cy,
and ``doubts`` says what is rare but possible. Cameras that are computed from others (cropped,
resized) are not checked.
"""

from typing import List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry.camera import COEFFICIENTS, PinholeCamera
from fcsv_geometry.errors import GeometryError

#: of the larger side of the picture: an angle of view of 147 degrees, and of 0.6
_LEAST_FOCAL, _MOST_FOCAL = 0.15, 100.0
#: what is read with a warning: 90 % of all cameras have 0.5 to 3
_RARE_FOCAL = (0.25, 10.0)
_MOST_ASPECT, _RARE_ASPECT = 2.1, 1.1  # fx to fy; an anamorphic lens has 2
_MIDDLE, _FAR = (
    (0.25, 0.75),
    (-1.0, 2.0),
)  # share of width or height: where principal points are, and never are
_BORDER = 0.01
_ALIKE = 0.05  # share of the picture
_OTHER_SIZE = 0.2
_TOY_PX = 8  # a picture so small has its principal point at the border by rounding
_UNKNOWN_FOCAL = (65535.0, 2147483647.0, 4294967295.0)  # how 16 and 32 bits say "not known"
_METRES, _SHARES = 0.1, 5.0  # focal lengths below: in metres; a share of the width
_BENT = (0.2, 5.0)  # what distortion makes of a radius half way to the corner
_FISHEYE = ("equidistant", "fisheye", "kannala_brandt", "kannala_brandt4", "opencv_fisheye")
_UNNAMED = ("", "none", "pinhole")
_BROWN, _RATIONAL = "plumb_bob", "rational_polynomial"
_NUMBERS = ", ".join(map(str, COEFFICIENTS[:-1])) + f" or {COEFFICIENTS[-1]}"


def camera_of_matrix(
    width: int, height: int, K: Sequence[float], D: Sequence[float], model: str
) -> PinholeCamera:
    """Makes a camera from a 3x3 matrix (row by row), coefficients in OpenCV's order and ROS's name
    of their model.

    Raises GeometryError that says what is wrong and what is likely meant.
    """
    distortion = coefficients(D, model)
    fx, fy, cx, cy = _entries(np.asarray(K, float).reshape(3, 3))
    return require_plausible(PinholeCamera(int(width), int(height), fx, fy, cx, cy, distortion))


def require_plausible(camera: PinholeCamera) -> PinholeCamera:
    """The camera back. Raises GeometryError that says what is wrong and what is likely meant.

    >>> try:
    ...     require_plausible(PinholeCamera(640, 480, 0.004, 0.004, 319.5, 239.5))
    ... except GeometryError as error:
    ...     print(str(error)[:71])
    focal length is 0.004 px in a picture of 640x480: is it in metres? foca
    """
    for check in (_focal_problem, _aspect_problem, _principal_point_problem, _distortion_problem):
        problem = check(camera)
        if problem:
            raise GeometryError(problem)
    return camera


def doubts(camera: PinholeCamera) -> List[str]:
    """What is rare about a plausible camera, in words; empty: nothing."""
    found, share = [], max(camera.fx, camera.fy) / max(camera.width, camera.height)
    if not _RARE_FOCAL[0] <= share <= _RARE_FOCAL[1]:
        found.append(
            f"focal length {camera.fx:.6g} px is {share:.3g} times the picture's larger side"
        )
    if _ratio(camera.fx, camera.fy) > _RARE_ASPECT:
        found.append(f"fx is {camera.fx:.6g} px and fy {camera.fy:.6g} px")
    at = _principal_point_share(camera)
    if min(camera.width, camera.height) > _TOY_PX and not all(
        _MIDDLE[0] <= s <= _MIDDLE[1] for s in at
    ):
        found.append(
            f"principal point {_point(camera)} is far from the middle of "
            f"{camera.width}x{camera.height}"
        )
    return found


def coefficients(D: Sequence[float], model: str) -> Tuple[float, ...]:
    """Distortion coefficients as OpenCV takes them: 5, 8, 12 or 14. Raises GeometryError.

    Zeros are no distortion, however many. Zeros at the end change nothing, missing ones are zero.

    >>> coefficients([0.1, -0.2, 0, 0, 0, 0, 0, 0], "rational_polynomial")
    (0.1, -0.2, 0.0, 0.0, 0.0)
    """
    given = [float(d) for d in D]
    name = model.strip().lower()
    if not np.isfinite(given).all():
        raise GeometryError(f"distortion D holds NaN or infinity: {given}")
    if name in _FISHEYE:
        raise GeometryError(
            f"distortion model '{model}' is of a fisheye; only pinhole cameras are known: undistort "
            "the pictures first (cv2.fisheye.undistortImage) and give the new K"
        )
    if name not in (*_UNNAMED, _BROWN, _RATIONAL):
        raise GeometryError(
            f"distortion model '{model}' is not known, only {_BROWN} and {_RATIONAL}"
        )
    values = list(given)
    while values and values[-1] == 0.0:
        values.pop()
    if values and name in _UNNAMED:
        raise GeometryError(f"D has values, but the distortion model is '{model}': is it {_BROWN}?")
    if values and len(given) not in COEFFICIENTS and not 4 <= len(values) <= 5:
        raise GeometryError(
            f"distortion D has {len(given)} coefficients where {_BROWN} has 5 "
            f"(k1, k2, p1, p2, k3); OpenCV takes {_NUMBERS}: write 0 for those that it lacks"
        )
    if len(values) > 5 and name == _BROWN:
        raise GeometryError(
            f"distortion D has {len(given)} coefficients where {_BROWN} has 5: "
            f"is the distortion model {_RATIONAL}?"
        )
    count = next(n for n in COEFFICIENTS if n >= max(5, len(values)))
    return tuple(values + [0.0] * (count - len(values)))


def model_of(distortion: Sequence[float]) -> str:
    """ROS's name of the distortion model of a camera's coefficients."""
    return _BROWN if len(distortion) <= 5 else _RATIONAL


def _entries(K: np.ndarray) -> Tuple[float, float, float, float]:
    """fx, fy, cx, cy."""
    (fx, skew, cx), (k10, fy, cy), (k20, k21, k22) = K.tolist()
    said = f"K is {[float(f'{v:.6g}') for v in K.ravel()]}"
    if not np.isfinite(K).all():
        raise GeometryError(f"K holds NaN or infinity: {said}")
    if not K.any():
        raise GeometryError("camera is not calibrated (K is zero)")
    if (K == np.eye(3)).all() or (K == 1.0).all():
        raise GeometryError(f"camera is not calibrated ({said}): calibrate it (calibrate_camera)")
    if not cx and not cy and (k20 or k21):
        raise GeometryError(
            f"K is transposed, with cx and cy in the bottom row ({said}): it is written row by row"
        )
    if max(map(abs, (k10, k20, k21, k22 - 1.0))) > 1e-6:
        raise GeometryError(f"{said}: it is no camera matrix (fx 0 cx, 0 fy cy, 0 0 1)")
    if abs(skew) > 1e-3 * abs(fx):
        raise GeometryError(
            f"K has a skew of {skew:.6g} ({said}); only pixels with a right angle are known"
        )
    return fx, fy, cx, cy


def _focal_problem(camera: PinholeCamera) -> Optional[str]:
    width, height = camera.width, camera.height
    side = max(width, height)
    for f in (camera.fx, camera.fy):
        said = f"focal length is {f:.6g} px in a picture of {width}x{height}"
        if f in _UNKNOWN_FOCAL:
            return f"{said}: it stands for a focal length that is not known; calibrate the camera"
        if f > _MOST_FOCAL * side:
            return f"{said}: no camera sees so little; focal lengths are in px"
        if f < _LEAST_FOCAL * side:
            return f"{said}: {_small_focal(f)}"
    return None


def _small_focal(f: float) -> str:
    in_px = "focal lengths are in px"
    if f < 1e-4:
        return f"is the camera calibrated? {in_px}"
    if f < _METRES:
        return f"is it in metres? {in_px} (metres divided by the size of a pixel)"
    if f < _SHARES:
        return f"is it in mm, or a share of the picture's width? {in_px}"
    return f"is it in mm, or of a smaller picture? {in_px}"


def _ratio(a: float, b: float) -> float:
    return max(a, b) / min(a, b)


def _aspect_problem(camera: PinholeCamera) -> Optional[str]:
    if _ratio(camera.fx, camera.fy) <= _MOST_ASPECT:
        return None
    said = f"fx is {camera.fx:.6g} px and fy {camera.fy:.6g} px"
    return f"{said}: no camera has such pixels; is one of them mistyped?"


def _point(camera: PinholeCamera) -> str:
    return f"{camera.cx:.6g}, {camera.cy:.6g}"


def _principal_point_share(camera: PinholeCamera) -> Tuple[float, float]:
    """Where it is in the picture: 0.5, 0.5 is its middle."""
    return (camera.cx + 0.5) / camera.width, (camera.cy + 0.5) / camera.height


def _off_middle(at: Tuple[float, float]) -> float:
    return max(abs(s - 0.5) for s in at)


def _principal_point_problem(camera: PinholeCamera) -> Optional[str]:
    width, height = camera.width, camera.height
    at = _principal_point_share(camera)
    said = f"principal point (cx, cy) is {_point(camera)} in a picture of {width}x{height}"
    if min(width, height) <= _TOY_PX:
        return None
    if all(abs(c) <= 1.0 for c in (camera.cx, camera.cy)):
        return f"{said}: was it never set? The middle is {(width - 1) / 2:g}, {(height - 1) / 2:g}"
    if not all(_FAR[0] <= s <= _FAR[1] for s in at):
        return f"{said}: far outside of it; cx and cy are in px from the first pixel"
    exchanged = ((camera.cx + 0.5) / height, (camera.cy + 0.5) / width)
    if _off_middle(exchanged) < _ALIKE and _off_middle(at) > 2 * _ALIKE:
        return f"{said}: are cx and cy exchanged, or is the picture turned by 90 degrees?"
    if any(min(abs(s), abs(s - 1.0)) < _BORDER for s in at):
        return f"{said}: on its border; is K of a picture of another size, or was it never set?"
    if abs(at[0] - at[1]) < _ALIKE and abs(sum(at) / 2 - 0.5) > _OTHER_SIZE:
        return f"{said}: is K of a picture of {2 * camera.cx + 1:.0f}x{2 * camera.cy + 1:.0f}?"
    return None


def _distortion_problem(camera: PinholeCamera) -> Optional[str]:
    """Half way to the corners, which every calibration has seen."""
    if not any(camera.distortion):
        return None
    half = 0.25 * np.array([camera.width / camera.fx, camera.height / camera.fy])
    corners = np.array([[u * half[0], v * half[1], 1.0] for u in (-1, 1) for v in (-1, 1)])
    with np.errstate(all="ignore"):
        seen = (camera.project(corners) - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
        factors = np.sum(seen * corners[:, :2], axis=1) / np.sum(corners[:, :2] ** 2, axis=1)
    if np.isfinite(factors).all() and _BENT[0] < factors.min() and factors.max() < _BENT[1]:
        return None
    said = [float(f"{d:.6g}") for d in camera.distortion]
    return f"distortion {said} folds the picture: D is not this camera's"
