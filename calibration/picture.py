"""Which pictures a camera is for, and the same camera for others of the same sensor: a part of them, scaled, turned.

A camera model holds for pictures of one size, one part of the sensor, one way up. Nothing here guesses: where a video's
pictures are others, `fitted` refuses and writes the line that would make it right.

With x the direction's coordinates at z = 1 and the picture turned clockwise by 90 degrees, x' = (-y, x) and
pixel' = (h - 1 - y, x); the tangential terms (p2, p1) and the thin prism's (s1, s3), (s2, s4) turn as vectors do, the
radial ones stay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from calibration.camera import CameraModel, area_matrix
from calibration.foundation.arrays import Floats
from calibration.foundation.errors import UsageError

SAME_SHAPE = 0.005
"""Difference of the scales of width and height that rounding to whole (often even) sizes explains."""

ASPECT_APART = 0.05
"""fx / fy from what the pixels' shape says, beyond which they contradict; lenses and pixels differ by 0.01."""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """How the pictures of a video (or photos) come.

    size           (width, height) in pixels, as they are shown
    turned_deg     clockwise, from the pixels as they are stored, by the file's rotation tag: 0, 90, 180, 270
    sample_aspect  width over height of a pixel
    said           what the file says of its camera ("maker", "camera"), where it says anything
    """

    size: tuple[int, int]
    turned_deg: int = 0
    sample_aspect: float = 1.0
    said: Mapping[str, str] = field(default_factory=dict, compare=False)


@dataclass(frozen=True, kw_only=True)
class Area:
    """The part of the calibrated picture that a video shows: crop (x, y, width, height) of a picture of size `of`."""

    crop: tuple[float, float, float, float]
    of: tuple[int, int]


def scaled(camera: CameraModel, area: Area, size: tuple[int, int]) -> CameraModel:
    """The camera of pictures that show `area` of its own, scaled to `size`.

    Raises UsageError where the camera is of another size, the area not inside, or its shape not that of `size`.
    """
    x, y, width, height = area.crop
    if camera.image_size not in ((0, 0), area.of):
        raise UsageError(
            where="area",
            seen=f"a part of {_by(area.of)}",
            expected=f"a part of {_by(camera.image_size)}, which the camera file is for",
            advice=f"of = [{camera.image_size[0]}, {camera.image_size[1]}]",
        )
    if min(x, y) < 0 or min(width, height) <= 0 or x + width > area.of[0] or y + height > area.of[1]:
        raise UsageError(
            where="area",
            seen=f"{width:g} x {height:g} from {x:g}, {y:g}",
            expected=f"x, y, width and height of a part of {_by(area.of)}",
            advice="count from the top left corner",
        )
    if [x, y, width, height] == [0, 0, *size] and size == area.of:
        return replace(camera, image_size=size)
    scale = size[0] / width, size[1] / height
    if abs(np.log(scale[0] / scale[1])) > max(SAME_SHAPE, 1.5 / min(size)):
        raise UsageError(
            where="area",
            seen=f"{width:g} x {height:g}, scaled to {_by(size)}: by {scale[0]:.4f} across and {scale[1]:.4f} down",
            expected="a part of the same shape as the picture",
            advice=f"a height of {width * size[1] / size[0]:.0f}, or a width of {height * size[0] / size[1]:.0f}",
        )
    part = f"{width:g} x {height:g} from {x:g}, {y:g} of {_by(area.of)}, scaled to {_by(size)}"
    stretch = np.ones(4 + len(camera.distortion))
    stretch[:4] = scale[0], scale[1], scale[0], scale[1]
    return replace(
        camera,
        image_size=size,
        K=area_matrix(camera.K, (x, y), scale),
        covariance=None if camera.covariance is None else camera.covariance * np.outer(stretch, stretch),
        rms_px=None if camera.rms_px is None else camera.rms_px * float(np.sqrt(scale[0] * scale[1])),
        made={**camera.made, "area": part},
    )


def turned(camera: CameraModel, clockwise_deg: int) -> CameraModel:
    """The camera of its pictures turned clockwise by 0, 90, 180 or 270 degrees. Raises UsageError for other angles."""
    if clockwise_deg % 90:
        raise UsageError(
            where="turn", seen=f"{clockwise_deg} degrees", expected="90, 180 or 270, clockwise", advice="choose one"
        )
    for _ in range(clockwise_deg // 90 % 4):
        camera = _turned_once(camera)
    return camera


def _turned_once(camera: CameraModel) -> CameraModel:
    if len(camera.distortion) == 14 and np.any(camera.distortion[12:]):
        raise UsageError(
            where="turn",
            seen="a tilted sensor (the 13th and 14th coefficient)",
            expected="a lens without tilt, to be turned",
            advice="calibrate with pictures that are turned as the video's",
        )
    width, height = camera.image_size
    before, n = _turned_deg(camera), 4 + len(camera.distortion)
    turn: Floats = np.eye(n)
    exchanged = [(0, 1, 1.0, 1.0), (2, 3, -1.0, 1.0)]
    if camera.model == "pinhole":
        # (x, y) -> (-y, x) of (p2, p1), (s1, s3), (s2, s4)
        exchanged += [(x, y, -1.0, 1.0) for x, y in ((7, 6), (12, 14), (13, 15)) if max(x, y) < n]
    for x, y, first, second in exchanged:
        turn[[x, y]] = 0.0
        turn[x, y], turn[y, x] = first, second
    values = turn @ np.concatenate([camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], camera.distortion])
    values[2] += height - 1
    return replace(
        camera,
        image_size=(height, width),
        K=np.array([[values[0], 0, values[2]], [0, values[1], values[3]], [0, 0, 1]]),
        distortion=values[4:],
        covariance=None if camera.covariance is None else turn @ camera.covariance @ turn.T,
        made={**camera.made, **({} if before is None else {"turned_deg": (before + 90) % 360})},
    )


def fitted(
    camera: CameraModel, picture: Picture, *, file: Path, video: Path, where: str, area: Area | None = None
) -> CameraModel:
    """The camera of the pictures of a video: its own, or of the part that `area` says.

    file, video  the camera file and the video, for messages; where: the key or option that brought them together
    Raises UsageError with both values, and the line that would make it right, where size, turn or shape of the pixels
    are others. A file without a size is taken for the video's where its principal point is near the middle.
    """
    _refuse_turned(camera, picture, file, video, where)
    if area is not None:
        try:
            made = scaled(camera, area, picture.size)
        except UsageError as error:
            raise UsageError(where=where, seen=error.seen, expected=error.expected, advice=error.advice) from None
    elif camera.image_size == picture.size:
        made = camera
    elif camera.image_size == (0, 0):
        made = replace(camera, image_size=picture.size)
        _refuse_far_centre(made, picture, file, video, where)
    else:
        raise _other_size(camera, picture, file, video, where)
    _refuse_pixel_shape(made, picture, file, video, where)
    other = _other_camera(camera, picture, file, video)
    return replace(made, made={**made.made, OTHER_CAMERA: other}) if other else made


OTHER_CAMERA = "other_camera"
"""Key of `made` under which stands, in words, that the video says another camera than the camera file; see `doubts`."""


def _other_camera(camera: CameraModel, picture: Picture, file: Path, video: Path) -> str:
    """A sentence where both say which model took them, and not the same; names may be part of one another."""
    mine, theirs = (str(said.get("camera", "")).strip() for said in (camera.made, picture.said))
    a, b = mine.casefold(), theirs.casefold()
    if not a or not b or a in b or b in a:
        return ""
    return f"{file.name} was made with photos by {mine!r}, and {video.name} says {theirs!r}: is it this camera's file?"


def for_pictures(
    camera: CameraModel, picture: Picture, *, file: Path, video: Path, where: str, crop: Area | None = None
) -> CameraModel:
    """The camera made to fit the pictures of a video by what is known: turned by the tag, cropped as asked, scaled.

    Without `crop` the video must show the whole calibrated picture, that is, have its shape. Raises as `fitted`.
    """
    have = _turned_deg(camera)
    if have is not None:
        camera = turned(camera, (picture.turned_deg - have) % 360)
    (w, h), (vw, vh) = camera.image_size, picture.size
    if crop is None and min(w, h) > 0 and abs(np.log(vw / w) - np.log(vh / h)) <= max(SAME_SHAPE, 1.5 / min(vw, vh)):
        crop = Area(crop=(0, 0, w, h), of=(w, h))
    return fitted(camera, picture, file=file, video=video, where=where, area=crop)


def _turned_deg(camera: CameraModel) -> int | None:
    said = camera.made.get("turned_deg")
    return int(said) % 360 if isinstance(said, int | float) else None


def _refuse_turned(camera: CameraModel, picture: Picture, file: Path, video: Path, where: str) -> None:
    have = _turned_deg(camera)
    if have is None or have == picture.turned_deg % 360:
        return
    need = (picture.turned_deg - have) % 360
    raise UsageError(
        where=where,
        seen=f"{video.name} is shown turned by {picture.turned_deg} degrees (its rotation tag), and {file.name} is of "
        f"pictures turned by {have}",
        expected="a camera file of pictures that are as the video's",
        advice=f"runningfix camera scale {file.name} --turn {need} -o {file.stem}-turned.json, and calibration = "
        f'"{file.stem}-turned.json"',
    )


def _other_size(camera: CameraModel, picture: Picture, file: Path, video: Path, where: str) -> UsageError:
    (w, h), (vw, vh) = camera.image_size, picture.size
    ratio = np.log(vw / w) - np.log(vh / h)
    if abs(ratio) <= max(SAME_SHAPE, 1.5 / min(vw, vh)):
        scale = f"runningfix camera scale {file.name} --to {vw}x{vh} -o {file.stem}-{vw}x{vh}.json"
        advice = f"video_area = {{ crop = [0, 0, {w}, {h}], of = [{w}, {h}] }} if the video is the whole picture scaled"
        advice = f"{advice} ({scale} writes a file of it); else a calibration from pictures as the video's"
    elif abs(np.log(vw / h) - np.log(vh / w)) <= max(SAME_SHAPE, 1.5 / min(vw, vh)):
        advice = (
            f"runningfix camera scale {file.name} --turn 90 -o {file.stem}-turned.json (or 270) if the video is turned"
        )
    else:
        across = ratio > 0
        part = (w, round(w * vh / vw)) if across else (round(h * vw / vh), h)
        x, y = (w - part[0]) // 2, (h - part[1]) // 2
        advice = (
            f"video_area = {{ crop = [{x}, {y}, {part[0]}, {part[1]}], of = [{w}, {h}] }} if the video shows the "
            f"middle of the picture over its whole {'width' if across else 'height'}; else a calibration from "
            "pictures as the video's"
        )
    return UsageError(
        where=where,
        seen=f"{file.name} is of {_by(camera.image_size)} pictures, {video.name} of {_by(picture.size)}",
        expected="a camera file of the video's own pictures, or word of the part of the picture that the video shows",
        advice=advice,
    )


def _refuse_far_centre(camera: CameraModel, picture: Picture, file: Path, video: Path, where: str) -> None:
    cx, cy = camera.K[0, 2], camera.K[1, 2]
    off = abs(cx + 0.5 - picture.size[0] / 2) / picture.size[0], abs(cy + 0.5 - picture.size[1] / 2) / picture.size[1]
    if max(off) > FAR:
        raise UsageError(
            where=where,
            seen=f"{file.name} has its principal point at {cx:.0f}, {cy:.0f}, that of {2 * cx + 1:.0f} x "
            f"{2 * cy + 1:.0f} pictures; {video.name} is {_by(picture.size)}",
            expected="a camera file of the video's own pictures",
            advice=f"add image_size to {file.name}: the size of the pictures it was made from",
        )


FAR = 0.1
"""Principal point from the middle, in shares of a side, from which a file without a size is not the video's."""


def _refuse_pixel_shape(camera: CameraModel, picture: Picture, file: Path, video: Path, where: str) -> None:
    """Pixels wider than high by a have fx / fy = 1 / a."""
    fx, fy = camera.K[0, 0], camera.K[1, 1]
    said = camera.made.get("sample_aspect")
    if picture.sample_aspect == 1.0 and said in (None, 1.0):
        return
    if abs(np.log(fx / fy * picture.sample_aspect)) <= ASPECT_APART:
        return
    w, h = picture.size
    raise UsageError(
        where=where,
        seen=f"{video.name} has pixels {picture.sample_aspect:.4g} times as wide as high, and {file.name} fx / fy = "
        f"{fx / fy:.4f}",
        expected=f"fx / fy = {1 / picture.sample_aspect:.4f}",
        advice=f"calibrate with pictures as the video's: runningfix calibrate {video.name} of a board, or a video of "
        f"square pixels: ffmpeg -i {video.name} -vf scale={round(w * picture.sample_aspect)}:{h},setsar=1 square.mp4",
    )


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
