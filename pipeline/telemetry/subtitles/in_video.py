"""Subtitles that lie in the video file itself, as DJI's drones write them into their .MP4."""

from __future__ import annotations

from pathlib import Path

from calibration.foundation.errors import InputFileError

VIDEO_NAMES = frozenset((".mp4", ".mov", ".m4v", ".mkv"))
SUBTITLE_NAMES = frozenset(("mov_text", "srt", "subrip", "text"))


def subtitles_in(path: Path) -> str:
    """The first subtitle track of a video as the text of an .SRT, times counted from the video's first frame.

    Raises InputFileError where the video cannot be opened or has none.
    """
    import av  # here, for it is slow to import

    from calibration.foundation.capture import container_of

    try:
        with path.open("rb") as file, container_of(file) as container:
            known = [s for s in container.streams.subtitles if s.codec_context is not None]
            tracks = [s for s in known if s.codec_context.name in SUBTITLE_NAMES]
            if not tracks:
                raise _none(path)
            video = next(iter(container.streams.video), None)
            begin = 0.0
            if video is not None and video.start_time is not None and video.time_base is not None:
                begin = float(video.start_time * video.time_base)
            form = tracks[0].codec_context.name
            found = [
                (float(packet.pts * packet.time_base) - begin, text_of(bytes(packet), form))
                for packet in container.demux(tracks[0])
                if packet.pts is not None and packet.size
            ]
    except (av.FFmpegError, OSError) as error:
        raise InputFileError(
            where=str(path),
            seen=f"a video that cannot be opened ({error})",
            expected="a video with a log in it",
            advice="copy the video again",
        ) from None
    cues = [f"{i}\n{_clock(time)} --> {_clock(time)}\n{text}\n" for i, (time, text) in enumerate(found, 1) if text]
    if not cues:
        raise _none(path)
    return "\n".join(cues)


def text_of(packet: bytes, form: str) -> str:
    """What one packet shows; QuickTime's text (mov_text) has its length before it and styles behind."""
    if form == "mov_text":
        packet = packet[2 : 2 + int.from_bytes(packet[:2], "big")]
    return packet.decode("utf-8", "replace").strip()


def _clock(time_s: float) -> str:
    milliseconds = max(round(time_s * 1000), 0)
    seconds, thousandths = divmod(milliseconds, 1000)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d},{thousandths:03d}"


def _none(path: Path) -> InputFileError:
    return InputFileError(
        where=str(path),
        seen="a video that carries no log",
        expected="metadata of MISB ST 0601 in a .ts, or DJI's subtitles in the video",
        advice="name the flight's log as `telemetry` (a drone's .SRT often lies beside its video)",
    )
