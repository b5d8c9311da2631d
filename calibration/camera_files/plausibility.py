"""Values that no camera has, and values that few have: the first are refused, the second told.

Most come from files of programs that count otherwise: focal lengths in shares of the image or in millimetres, a matrix
written column by column, the matrix of one resolution beside the size of another.
"""

from __future__ import annotations

import numpy as np

from calibration.camera import CameraModel, unproject
from calibration.foundation.arrays import Floats

UNKNOWN_SIZE = (0, 0)

LEAST_FOCAL = 0.1
"""Least focal length over the longer side. A fisheye that sees 180 degrees has 0.32, one of 220 degrees 0.26; shares of
the image have 1e-4, millimetres 1e-3. Doubled, the widest lenses come near."""

MOST_FOCAL = 100.0
"""Largest: a view of 0.6 degrees."""

LEAST_FOCAL_PX, LEAST_CENTRE_PX = 60.0, 20.0
"""Focal length and principal point where the file gives no size: no lens and picture are so small (a thermal camera of
80 x 60 has 84 and 30), and 35 mm, 18 and 12 mm of a whole frame are."""

EXCHANGED = 0.03
"""Principal point from the middle of the picture with width and height exchanged, up to which that is the mistake."""

TOLD_TANGENTIAL = 0.02
"""Tangential terms p1, p2 from which they are told. Lenses have up to 0.005; a fisheye's k3 and k4, and a k3 where the
order k1, k2, k3, p1, p2 is meant, have 0.01 to 1."""

OFF_CENTRE, FAR_OFF_CENTRE = 0.1, 0.25
"""Principal point from the image's middle, in shares of the side: told, refused. Real lenses: up to 0.05; K of another
size: 0.17 for 1280 beside 1920 or 720 beside 1080, 0.25 for half. A cropped picture can have any: it is told as one."""

UNEQUAL, FAR_UNEQUAL = 1.1, 1.5
"""Larger focal length over the smaller: told (a picture stretched to another shape: 16:9 from 4:3 is 1.33), refused."""

SEEN_LATTICE = 9
"""Points each way at which the picture is asked for directions."""


class NotACamera(ValueError):  # noqa: N818  (an intermediate verdict, turned into an InputFileError)
    """Why a mapping is no camera: what was seen, what was expected, and where there is any, the advice."""

    def __init__(self, key: str, seen: str, expected: str, advice: str = "") -> None:
        self.key, self.seen, self.expected, self.advice = key, seen, expected, advice
        super().__init__(f"{key}: {seen}; expected {expected}")


def refuse_impossible(K: Floats, size: tuple[int, int], *, cropped: bool = False) -> None:
    """Raises NotACamera where `K` (3, 3) is no camera's, or none of pictures of `size` (width, height).

    Of pictures that are known to be `cropped`, the principal point may be anywhere.
    """
    _refuse_other_layout(K)
    _refuse_other_units(K, size)
    if size == UNKNOWN_SIZE and min(K[0, 2], K[1, 2]) < LEAST_CENTRE_PX:
        raise NotACamera(
            "K", f"a principal point of {K[0, 2]:g}, {K[1, 2]:g}, and no image size", "pixels of the picture"
        )
    if size != UNKNOWN_SIZE and not cropped:
        _refuse_far_centre(K, size)


def _refuse_other_layout(K: Floats) -> None:
    if not K.any():
        raise NotACamera("K", "only zeros: the camera is not calibrated", "focal lengths above 0, in pixels")
    if np.allclose(K.T[2], (0, 0, 1)) and not np.allclose(K[2], (0, 0, 1)):
        raise NotACamera("K", f"a transposed matrix, last row {K[2].tolist()}", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    if not np.allclose(K[[1, 2, 2, 2], [0, 0, 1, 2]], (0, 0, 0, 1), atol=1e-9):
        raise NotACamera("K", f"last row {K[2].tolist()}", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], row by row")
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        raise NotACamera("K", f"focal lengths {K[0, 0]:g}, {K[1, 1]:g}", "focal lengths above 0, in pixels")
    if abs(K[0, 1]) > 1e-6 * K[0, 0]:
        raise NotACamera("K", f"skew {K[0, 1]:g}", "no skew: OpenCV's lens model has none")
    unequal = max(K[0, 0] / K[1, 1], K[1, 1] / K[0, 0])
    if unequal > FAR_UNEQUAL:
        raise NotACamera(
            "K", f"focal lengths {K[0, 0]:g}, {K[1, 1]:g}", "two nearly equal ones: pixels are nearly square"
        )


def _refuse_other_units(K: Floats, size: tuple[int, int]) -> None:
    longer, focal = max(size), float(min(K[0, 0], K[1, 1]))
    least = LEAST_FOCAL * longer if size != UNKNOWN_SIZE else LEAST_FOCAL_PX
    of = f"pixels of a {size[0]} x {size[1]} image" if size != UNKNOWN_SIZE else "pixels"
    if focal < least:
        raise NotACamera(
            "K",
            f"a focal length of {focal:g}, as in shares of the image or in millimetres",
            f"{of}: above {least:g}",
            "multiply shares by the side they are of, millimetres by pixels per millimetre",
        )
    if size != UNKNOWN_SIZE and focal > MOST_FOCAL * longer:
        raise NotACamera("K", f"a focal length of {focal:g}", f"{of}: below {MOST_FOCAL * longer:g}")


def _refuse_far_centre(K: Floats, size: tuple[int, int]) -> None:
    off, exchanged = max(off_centre(K, size)), max(off_centre(K, size[::-1]))
    if off <= FAR_OFF_CENTRE and not (off > OFF_CENTRE and exchanged < EXCHANGED):
        return
    words = "is K that of another size, or a part of a larger picture?"
    if exchanged < OFF_CENTRE:
        words = "are width and height exchanged?"
    raise NotACamera(
        "K",
        f"a principal point of {K[0, 2]:g}, {K[1, 2]:g} in a {size[0]} x {size[1]} image",
        f"a point near its middle, {(size[0] - 1) / 2:g}, {(size[1] - 1) / 2:g}; {words}",
        f"give the size that K is of (its middle would fit {implied_size(K)}); for a part of a larger picture keep "
        "K and size of the whole, and say `video_area` in the flight file, or use `runningfix camera scale`",
    )


def off_centre(K: Floats, size: tuple[int, int]) -> tuple[float, float]:
    """How far the principal point is from the middle, in shares of width and height."""
    return abs(K[0, 2] + 0.5 - size[0] / 2) / size[0], abs(K[1, 2] + 0.5 - size[1] / 2) / size[1]


def implied_size(K: Floats) -> str:
    """The size of a picture whose middle the principal point is, in words."""
    return f"about {2 * K[0, 2] + 1:.0f} x {2 * K[1, 2] + 1:.0f}"


TOLD = ("note", "other_camera")
"""Keys of `made` that hold a sentence for people: of a file without a size, of a video by another camera."""


def doubts(camera: CameraModel) -> tuple[str, ...]:
    """What few cameras have and should be looked at, one sentence each; little where nothing is known of the size."""
    size, K = camera.image_size, camera.K
    words = [str(camera.made[key]) for key in TOLD if key in camera.made]
    if size == UNKNOWN_SIZE:
        return tuple(words)
    if max(off_centre(K, size)) > OFF_CENTRE and "area" not in camera.made:
        words.append(
            f"the principal point {K[0, 2]:.0f}, {K[1, 2]:.0f} is far from the middle of a {size[0]} x {size[1]} image "
            f"(it is that of {implied_size(K)}): is K of another size, or the picture a part of a larger one?"
        )
    unequal = float(K[0, 0] / K[1, 1])
    if not 1 / UNEQUAL < unequal < UNEQUAL:
        words.append(f"fx / fy is {unequal:.3f}: were the pictures stretched to another shape?")
    if camera.model == "pinhole" and len(camera.distortion) >= 4:
        p1, p2 = camera.distortion[2:4]
        if max(abs(p1), abs(p2)) > TOLD_TANGENTIAL:
            words.append(
                f"tangential terms p1, p2 = {p1:g}, {p2:g} are large: a fisheye's coefficients, or in another order "
                "than k1, k2, p1, p2, k3?"
            )
    blind = _blind(camera)
    if blind > 0:
        words.append(
            f"the lens model folds back on itself: {blind:.0%} of the picture has no direction, and "
            "targets there are not used"
        )
    return tuple(words)


def _blind(camera: CameraModel) -> float:
    """Share of the picture that no direction maps to; what a fisheye's corners do not show is no mistake."""
    if camera.model == "fisheye":
        return 0.0
    return 1 - float(np.isfinite(unproject(camera, _all_over(camera.image_size))[:, 0]).mean())


def _all_over(size: tuple[int, int]) -> Floats:
    x, y = np.meshgrid(np.linspace(0, size[0] - 1, SEEN_LATTICE), np.linspace(0, size[1] - 1, SEEN_LATTICE))
    return np.stack([x.ravel(), y.ravel()], axis=1)
