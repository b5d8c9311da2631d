"""Videos in the containers that FFmpeg writes; each frame has its number drawn in, which any decoder shows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from tests.scenes.video import SIZE, panning

BLOCK = 12  # side of a drawn digit
DIGITS = 8


def numbered(frames: int) -> list[np.ndarray]:
    """The panning scene with every frame's number in its last rows, in binary."""
    images = panning(frames)
    for number, image in enumerate(images):
        for digit in range(DIGITS):
            x = 8 + digit * (BLOCK + 6)
            image[-BLOCK - 6 :, x - 3 : x + BLOCK + 3] = 0
            image[-BLOCK - 3 : -3, x : x + BLOCK] = 255 * (number >> digit & 1)
    return images


def number_in(image: np.ndarray, size: tuple[int, int] = SIZE) -> int:
    """The number that is drawn in a picture of `size`, scaled or not."""
    fx, fy = image.shape[1] / size[0], image.shape[0] / size[1]
    y = round((size[1] - 3 - BLOCK / 2) * fy)
    columns = [round((8 + digit * (BLOCK + 6) + BLOCK / 2) * fx) for digit in range(DIGITS)]
    return sum(int(image[y - 1 : y + 2, x - 1 : x + 2].mean() > 127) << digit for digit, x in enumerate(columns))


def muxed(
    path: Path,
    images: Sequence[np.ndarray],
    codec: str = "libx264",
    *,
    rate: Fraction = Fraction(25),
    times_s: Iterable[float] | None = None,
    from_s: float = 0.0,
    pixel_format: str = "yuv420p",
    options: dict[str, str] | None = None,
    container: dict[str, str] | None = None,
    format: str | None = None,
    rotation_deg: float | None = None,
    sample_aspect: Fraction | None = None,
    gop: int = 12,
    more: Sequence[tuple[str, Sequence[np.ndarray]]] = (),
    more_first: bool = False,
    interlaced: bool = False,
) -> Path:
    """Writes frames to `path`; `from_s` is the first one's time, `more` other streams (codec, pictures)."""
    with av.open(str(path), "w", format=format, options=container or {}) as out:
        others = [_stream(out, name, pictures[0], rate, "yuvj420p", 12, {}) for name, pictures in more if more_first]
        stream = _stream(out, codec, images[0], rate, pixel_format, gop, options or {})
        if not more_first:
            others = [_stream(out, name, pictures[0], rate, "yuvj420p", 12, {}) for name, pictures in more]
        if rotation_deg is not None:
            stream.set_display_rotation(rotation_deg)
        if sample_aspect is not None:
            stream.codec_context.sample_aspect_ratio = sample_aspect
        base = Fraction(1, 1000) if times_s is not None else 1 / rate
        stream.time_base = stream.codec_context.time_base = base
        when = [round((t + from_s) / base) for t in times_s] if times_s is not None else None
        start = round(from_s / base)
        for k, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format=pixel_format)
            frame.pts, frame.time_base = (start + k if when is None else when[k]), base
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
        for other, (_, pictures) in zip(others, more, strict=True):
            for k, image in enumerate(pictures):
                frame = av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format="yuvj420p")
                frame.pts, frame.time_base = start + k, 1 / rate
                out.mux(other.encode(frame))
            out.mux(other.encode(None))
    return path


def _stream(out, codec, image, rate, pixel_format, gop, options):
    stream = out.add_stream(codec, rate=rate, options={"threads": "1", **options})
    stream.width, stream.height, stream.pix_fmt = image.shape[1], image.shape[0], pixel_format
    stream.codec_context.gop_size = gop
    return stream


def packets_of(path: Path) -> list[tuple[int, int, bool]]:
    """Where the packets of the first video stream lie in the file: (position, size, key frame), in decoding order."""
    with av.open(str(path)) as container:
        return [(p.pos, p.size, p.is_keyframe) for p in container.demux(video=0) if p.size and p.pos is not None]


def overwritten(path: Path, to: Path, which: int) -> Path:
    """A copy in which most of packet number `which` (in decoding order) is zero: no decoder can read it."""
    raw = bytearray(path.read_bytes())
    position, size, _ = packets_of(path)[which]
    for at in range(position + min(24, size // 4), position + size):
        raw[at] = 0
    to.write_bytes(raw)
    return to
