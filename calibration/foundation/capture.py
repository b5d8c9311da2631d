"""The one way into a video: FFmpeg through PyAV, from an open file, so that no name is ever an address.

Times are the container's presentation times. Packets that an edit list cuts away are no frames. Pictures are upright,
as the container's rotation says. What cannot be read or decoded is stepped over. Which stream: the one that moves, an
attached picture is none; of several the first of the largest, or any by number.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import av
import numpy as np
import numpy.typing as npt
from av.codec.context import ThreadType
from av.container import InputContainer
from av.packet import Packet
from av.stream import Disposition
from av.video.frame import PictureType, VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from calibration.foundation.arrays import Floats
from calibration.foundation.decode_order import PacketOrder, PictureOrder, Sent, Told
from calibration.foundation.errors import InputFileError, RunningFixError, UsageError
from calibration.foundation.videos import open_video

Image = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int64]

MOST_REFUSED = 64
"""Times in a row that a container is asked for what lies behind something broken."""
ASKED_PACKETS = 300
"""Packets by which streams are told apart that move from those that do not."""
STRICT = {"mjpeg": "explode"}
"""Codecs whose decoder tells what it could not read only when it may refuse the frame for it (`err_detect`)."""
B_ALONE = ("mpeg1video", "mpeg2video", "mpeg4", "h263", "wmv1", "wmv2", "wmv3", "vc1")
"""Codecs that predict nothing from B frames, so that a damaged one harms none but itself."""
DECODING_TIMES_ONLY = ("avi",)
"""Containers that number their packets in the order in which they are decoded."""
UNKNOWN = -(1 << 62)
"""A time that no frame has."""
USUAL_RATE = 25.0
"""Where a container states none."""


@dataclass(frozen=True, kw_only=True)
class VideoHead:
    """What a container says of itself and shows at first.

    frame_rate     nominal, Hz
    image_size     (width, height) upright
    frames         how many packets it claims; 0 where it does not
    begin_s, end_s the time of the first frame, and at which it claims to end; 0 where it does not
    turned_deg     clockwise, by the rotation tag: 0, 90, 180, 270
    sample_aspect  width over height of a pixel, upright
    woven          whether it declares itself interlaced
    moving         how many streams move
    """

    frame_rate: float
    image_size: tuple[int, int]
    frames: int = 0
    begin_s: float = 0.0
    end_s: float = 0.0
    turned_deg: int = 0
    sample_aspect: float = 1.0
    woven: bool = False
    moving: int = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """A decoded frame: its number (from the first that decodes), its time, whether errors were concealed in it or in
    what it was predicted from, and its pixels in whatever form they were stored."""

    number: int
    stamp_s: float
    damaged: bool
    stored: VideoFrame


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameIndex:
    """Every frame of a video, from its packets.

    stamp_s  (n,) presentation times
    entry    (n,) where decoding has to begin for it (time base of the stream)
    hidden   packets that are no frames
    seekable whether times are good for finding frames
    """

    stamp_s: Floats
    entry: Integers
    hidden: int
    seekable: bool


class Capture:
    """A video held open. Not for several threads at once."""

    def __init__(self, path: Path, *, stream: int | None = None, threads: int = 0) -> None:
        """threads: of the decoder, 0 as many as processors. Raises InputFileError where it is no video, UsageError
        where it has no stream of that number."""
        self.path, self._wanted, self._threads = path, stream, threads
        self._reformatter = VideoReformatter()
        self._strict = True
        self._open()

    def _open(self) -> None:
        self._file = open_video(self.path)
        try:
            self._container = container_of(self._file)
            self._stream, self.moving = _chosen(self._container, self._wanted, self.path)
            self._stream.thread_type = ThreadType.AUTO
            self._stream.codec_context.thread_count = self._threads
            if self._strict and self._stream.codec_context.name in STRICT:
                self._stream.codec_context.options = {"err_detect": STRICT[self._stream.codec_context.name]}
        except (av.FFmpegError, OSError):
            self._file.close()
            raise _no_video(self.path) from None
        except RunningFixError:
            self._file.close()
            raise
        self._number = int(self._stream.index)
        self._base = float(self._stream.time_base or 1e-3)
        self._pictures = PictureOrder[VideoFrame]()
        self._shots = self._decoded(self._order(), self._pictures)
        self._first: Shot | None = None

    @property
    def frame_rate(self) -> float:
        """Nominal, Hz."""
        rate = float(self._stream.guessed_rate or self._stream.average_rate or 0.0)
        return rate if 0.01 < rate < 1e5 else USUAL_RATE

    def head(self) -> VideoHead:
        """What the container says, and its first frame shows. Raises InputFileError where nothing decodes."""
        first = self._peeked()
        if first is None:
            raise no_frames(self.path)
        turns = _turns(first.stored)
        aspect = float(self._stream.sample_aspect_ratio or 0.0) or 1.0
        size = first.stored.width, first.stored.height
        return VideoHead(
            frame_rate=self.frame_rate,
            image_size=size[::-1] if turns % 2 else size,
            frames=int(self._stream.frames),
            begin_s=first.stamp_s,
            end_s=self._claimed_end_s(),
            turned_deg=-90 * turns % 360,
            sample_aspect=1 / aspect if turns % 2 else aspect,
            woven=bool(first.stored.interlaced_frame),
            moving=self.moving,
        )

    @property
    def stream(self) -> int:
        """Number of the stream in the file."""
        return self._number

    @property
    def hidden(self) -> int:
        """Packets so far that are no frames, where all were decoded in order."""
        return self._pictures.hidden

    def stamps_s(self) -> Floats:
        """(n,) times of the frames so far by number, where all of them were decoded in order; also of those that did
        not decode."""
        return np.array(self._pictures.times, float) * self._base

    def shots(self) -> Iterator[Shot]:
        """Every frame that decodes, from where the video stands to its end."""
        first, self._first = self._peeked(), None
        if first is not None:
            yield first
        yield from self._shots

    def pixels(self, shot: Shot) -> Image:
        """The frame (h, w, 3) BGR, upright."""
        picture = self._reformatter.reformat(shot.stored, format="bgr24", threads=1)
        pixels = np.asarray(picture.to_ndarray(), np.uint8)
        turns = _turns(shot.stored)
        return np.ascontiguousarray(np.rot90(pixels, turns)) if turns else pixels

    def index(self) -> FrameIndex:
        """Every frame's time; nothing but the first is decoded. The video is at its beginning after it.

        Raises InputFileError where nothing decodes.
        """
        first = self._peeked()
        if first is None:
            raise no_frames(self.path)
        if first.stored.interlaced_frame:  # a field may be a packet
            for _ in self.shots():
                pass
            stamps = self.stamps_s()
            self.rewind()
            return FrameIndex(stamp_s=stamps, entry=np.full(len(stamps), UNKNOWN), hidden=0, seekable=False)
        self.rewind()
        found = self._scanned(first.stamp_s - self._base / 2)
        self.rewind()
        return found

    def _scanned(self, from_s: float) -> FrameIndex:
        order, entries, hidden, keys = self._order(), dict[int, int](), 0, dict[int, int]()
        untimed = False
        for packet in self._packets():
            sent = order.sent(packet.pts, packet.dts, key=packet.is_keyframe, discard=packet.is_discard)
            if sent.key:
                keys[sent.group] = sent.time
            untimed |= not sent.timed
            if sent.shown and sent.time * self._base >= from_s:
                entries[sent.time] = keys.get(sent.group - sent.leading, UNKNOWN)
            else:
                hidden += 1
        times = np.array(sorted(entries), np.int64)
        return FrameIndex(
            stamp_s=np.asarray(times * self._base, np.float64),
            entry=np.array([entries[int(t)] for t in times], np.int64),
            hidden=hidden,
            seekable=not (untimed or order.joins),
        )

    def shots_from(self, wanted: int, index: FrameIndex) -> Iterator[Shot]:
        """Frames from number `wanted`, or one before it, to the end; they begin at a key frame."""
        back = 0
        while index.seekable and back < 3 and int(index.entry[wanted]) != UNKNOWN:
            entry = int(index.entry[wanted])
            try:
                self._container.seek(entry - back * round(2.0 / self._base), stream=self._stream)
            except av.FFmpegError:
                break
            self._first = None
            found = self._sought(index)
            first = next(found, None)
            if first is not None and first.number <= wanted:
                yield first
                yield from found
                return
            back += 1
        self.rewind()
        yield from self.shots()

    def rewind(self) -> None:
        """Back to the beginning."""
        self.close()
        self._open()

    def close(self) -> None:
        """Lets go of the file."""
        self._shots.close()
        self._container.close()
        self._file.close()

    def _peeked(self) -> Shot | None:
        if self._first is None:
            self._first = next(self._shots, None)
        if self._first is None and self._strict:  # perhaps it was asked for too much
            self._strict = False
            self.rewind()
            self._first = next(self._shots, None)
        return self._first

    def _order(self) -> PacketOrder:
        reordered = bool(self._stream.codec_context.has_b_frames)
        timed = not (reordered and self._container.format.name in DECODING_TIMES_ONLY)
        return PacketOrder(self._base, 1.0 / self.frame_rate, timed)

    def _sought(self, index: FrameIndex) -> Iterator[Shot]:
        """Frames after a seek, from the first key frame on, numbered by their times."""
        for shot in self._decoded(self._order(), PictureOrder(), from_key=True):
            at = int(np.searchsorted(index.stamp_s, shot.stamp_s - self._base / 2))
            if at < len(index.stamp_s) and abs(index.stamp_s[at] - shot.stamp_s) < self._base / 2:
                yield Shot(number=at, stamp_s=shot.stamp_s, damaged=shot.damaged, stored=shot.stored)

    def _decoded(
        self, packets: PacketOrder, pictures: PictureOrder[VideoFrame], from_key: bool = False
    ) -> Generator[Shot, None, None]:
        """Frames from where the container stands; `from_key`: from the first whose group is whole."""
        places: dict[int, Sent] = {}
        for packet in self._packets(flush=True):
            if packet.size:
                sent = packets.sent(packet.pts, packet.dts, key=packet.is_keyframe, discard=packet.is_discard)
                if from_key and (sent.group == 0 or (sent.group == 1 and sent.leading)):
                    continue
                places[sent.place] = sent
                pictures.sent(sent, corrupt=packet.is_corrupt)
                packet.pts = sent.place  # a decoder carries it to the picture
            try:
                frames = packet.decode()
            except av.FFmpegError:
                pictures.refused()
                frames = []
            for frame in frames:
                known = places.pop(frame.pts, None) if frame.pts is not None else None
                if known is not None:
                    yield from map(
                        self._shot,
                        pictures.came(
                            known,
                            frame,
                            corrupt=frame.is_corrupt,
                            alone=self._alone(frame),
                            of_fields=frame.interlaced_frame,
                        ),
                    )
        yield from map(self._shot, pictures.ended())

    def _alone(self, frame: VideoFrame) -> bool:
        return frame.pict_type == PictureType.B and self._stream.codec_context.name in B_ALONE

    def _shot(self, told: Told[VideoFrame]) -> Shot:
        return Shot(number=told.number, stamp_s=told.time * self._base, damaged=told.damaged, stored=told.picture)

    def _packets(self, flush: bool = False) -> Iterator[Packet[VideoStream]]:
        """The stream's packets from where the container stands; `flush`: and the one that empties the decoder.

        A container that meets something broken says no more; so it is asked again for what lies behind.
        """
        refused = 0
        while refused < MOST_REFUSED:
            try:
                for packet in self._container.demux(self._stream):
                    refused = 0
                    if packet.size or flush:
                        yield packet
                return
            except av.FFmpegError:
                refused += 1

    def _claimed_end_s(self) -> float:
        """Matroska states the end in its head; others state nothing that holds, or count their frames."""
        if "matroska" not in self._container.format.name or len(self._container.streams) > 1:
            return 0.0
        return float(self._container.duration or 0) / av.time_base


def no_frames(path: Path) -> InputFileError:
    """The refusal of a video of which nothing can be decoded."""
    return InputFileError(
        where=str(path),
        seen="no frame that can be decoded",
        expected="at least one picture",
        advice="play the file with another program; copy it again from the camera",
    )


def container_of(file: BinaryIO) -> InputContainer:
    """A video by its bytes, never by its name: what it names beside itself is not opened. Raises as FFmpeg does."""
    return av.open(file, mode="r", metadata_errors="ignore", options={"fflags": "+genpts"}, io_open=_nothing_else)


def _nothing_else(url: str, flags: int, options: dict[str, str]) -> BinaryIO:
    """A video is one file; what it names beside itself is not opened."""
    raise FileNotFoundError(url)


def _turns(frame: VideoFrame) -> int:
    """Quarters by which a stored frame has to be turned counter-clockwise to be upright."""
    return round(frame.rotation / 90) % 4


STILL = Disposition.attached_pic | Disposition.timed_thumbnails | Disposition.still_image


def _chosen(container: InputContainer, wanted: int | None, path: Path) -> tuple[VideoStream, int]:
    """The stream asked for, else the one that moves; and how many do."""
    every = [s for s in container.streams.video if s.codec_context is not None]
    if wanted is not None:
        found = [s for s in every if s.index == wanted]
        if not found:
            raise UsageError(
                where=str(path),
                seen=f"no video stream of number {wanted}",
                expected=" or ".join(str(s.index) for s in every) or "a video",
                advice="streams count from 0, as ffprobe lists them",
            )
        return found[0], 1
    streams = [s for s in every if not s.disposition & STILL]
    if len(streams) > 1:
        streams = _those_that_move(streams, path)
    if not streams:
        raise _no_video(path)
    return max(streams, key=lambda s: (s.width or 0) * (s.height or 0)), len(streams)


def _those_that_move(streams: list[VideoStream], path: Path) -> list[VideoStream]:
    """Those with more than one packet among the first of the file, looked at apart; all where none has."""
    counts = dict.fromkeys((s.index for s in streams), 0)
    with open_video(path) as file, container_of(file) as apart:
        for packet in islice(apart.demux(video=tuple(range(len(apart.streams.video)))), ASKED_PACKETS):
            if packet.size and packet.stream_index in counts:
                counts[packet.stream_index] += 1
    return [s for s in streams if counts[s.index] > 1] or streams


def _no_video(path: Path) -> InputFileError:
    size = path.stat().st_size
    return InputFileError(
        where=str(path),
        seen="an empty file" if size == 0 else f"{size} bytes that are not a video, or one cut off before its index",
        expected="a video that FFmpeg opens (mp4, mov, mkv, avi, ts ...)",
        advice="play the file with another program; copy it again from the camera",
    )
