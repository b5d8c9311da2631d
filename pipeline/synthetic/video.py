"""Frames to an H.264 file: yuv420p, constant frame rate, the same bytes for the same frames.

The encoder is ffmpeg, run as a program of its own (extra `runningfix[demo]`); raw frames go through a pipe.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path

from calibration.foundation.errors import UsageError, WriteError
from pipeline.synthetic.landscape import Image

_EXACT = ("-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1")


def ffmpeg_program() -> str:
    """The encoder. Raises UsageError where it is not installed."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise UsageError(
            where="video encoder",
            seen="imageio-ffmpeg is not installed",
            expected="an H.264 encoder to render a flight with",
            advice="pip install 'runningfix[demo]'",
        ) from None


def write_video(path: Path, frames: Iterable[Image], *, size: tuple[int, int], rate_hz: float, crf: int = 18) -> int:
    """Encode `frames` (rows, columns, 3; blue, green, red) of `size` (width, height) and return how many there were.

    Frame f gets the time f / rate_hz exactly. The file appears whole or not at all. Raises UsageError without an
    encoder, WriteError where the file cannot be written.
    """
    program = ffmpeg_program()
    part = _part_of(path)
    try:
        count = _encode([program, *_arguments(size, rate_hz, crf), str(part)], frames)
        part.chmod(0o644)
        os.replace(part, path)
    except OSError as error:
        raise _write_error(path, error.strerror or str(error)) from None
    finally:
        part.unlink(missing_ok=True)
    return count


def _part_of(path: Path) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise _write_error(path, error.strerror or str(error)) from None
    os.close(handle)
    return Path(name)


def _arguments(size: tuple[int, int], rate_hz: float, crf: int) -> list[str]:
    raw = ["-f", "rawvideo", "-pix_fmt", "bgr24", "-s", f"{size[0]}x{size[1]}", "-r", f"{rate_hz:g}", "-i", "pipe:0"]
    colour = ["-vf", "scale=out_color_matrix=bt709:out_range=tv:flags=accurate_rnd+full_chroma_int+bicubic"]
    tags = ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709", "-color_range", "tv"]
    codec = ["-c:v", "libx264", "-preset", "veryfast", "-crf", str(crf), "-pix_fmt", "yuv420p", "-threads", "1"]
    return ["-v", "error", "-y", *raw, "-an", *colour, *codec, *tags, *_EXACT, "-f", "mp4"]


def _encode(command: list[str], frames: Iterable[Image]) -> int:
    count = 0
    with (
        tempfile.TemporaryFile() as words,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=words) as encoder,
    ):
        assert encoder.stdin is not None
        try:
            for frame in frames:
                encoder.stdin.write(frame.data)
                count += 1
            encoder.stdin.close()
        except BrokenPipeError:
            pass
        except BaseException:
            encoder.kill()
            raise
        if encoder.wait() != 0:
            words.seek(0)
            raise OSError(None, words.read().decode(errors="replace").strip().splitlines()[-1:] or "ffmpeg failed")
    return count


def _write_error(path: Path, seen: str) -> WriteError:
    return WriteError(
        where=str(path),
        seen=f"cannot be written ({seen})",
        expected="a writable folder with free space",
        advice="choose another -o folder",
    )
