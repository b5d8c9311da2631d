"""Which frame of a video a decoded picture is, and whether it is sound: packets go in in decoding order, pictures come
out in order of time.

number   its rank among the times of the frames that are shown, from the first that decodes; what never decodes keeps
         its number, what an edit list cuts away has none
damaged  the decoder concealed errors in it, or in a picture that was decoded before it in its group: from there to the
         next key frame everything may have been predicted from what was made up. A picture waits until all that was
         decoded before it has come, since what comes later may be what it was predicted from.
"""

from __future__ import annotations

import heapq
from array import array
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

Picture = TypeVar("Picture")

RESTART_S = 0.5
"""Decoding times that step back by more are of another recording, joined to the first. Doubled, short ones overlap."""
MOST_HELD = 20
"""Pictures that wait for what was decoded before them; no codec reorders more than 16."""


@dataclass(frozen=True, kw_only=True)
class Sent:
    """A packet as it went to the decoder.

    place    in decoding order
    group    how many key frames came up to it
    time     presentation time in units of the stream's time base; decoding time where `timed` is false
    key      whether it is a key frame
    leading  whether it is shown before its group's key frame, and so needs the group before too
    shown    whether it is a frame of the video: neither cut away by an edit list nor before everything that decodes
    """

    place: int
    group: int
    time: int
    timed: bool
    key: bool
    leading: bool
    shown: bool


@dataclass(frozen=True, kw_only=True)
class Told(Generic[Picture]):
    """A picture with its number, its time (time base) and whether it is damaged."""

    number: int
    time: int
    damaged: bool
    picture: Picture


class PacketOrder:
    """Gives packets their places; `joins` counts where the clock began anew."""

    def __init__(self, time_base: float, frame_s: float, timed: bool = True) -> None:
        """timed: whether the container knows when a frame is shown, not only when it is decoded."""
        self._base, self._frame, self._timed = time_base, max(1, round(frame_s / time_base)), timed
        self._place = self._group = self._shift = self.joins = 0
        self._key_time: int | None = None
        self._last_decoding: int | None = None

    def sent(self, pts: int | None, dts: int | None, *, key: bool, discard: bool) -> Sent:
        """The next packet."""
        timed = self._timed and pts is not None
        decoding = self._decoding(pts if dts is None else dts)
        time = pts + self._shift if timed and pts is not None else decoding
        if key:
            self._group, self._key_time = self._group + 1, time
        self._place += 1
        leading = self._key_time is not None and time < self._key_time
        return Sent(
            place=self._place, group=self._group, time=time, timed=timed, key=key, leading=leading, shown=not discard
        )

    def _decoding(self, told: int | None) -> int:
        """Decoding time, without end where the container tells none or begins anew."""
        last = self._last_decoding
        if told is None:
            now = 0 if last is None else last + self._frame
        else:
            if last is not None and (told + self._shift - last) * self._base < -RESTART_S:
                self._shift, self.joins = last + self._frame - told, self.joins + 1
            now = told + self._shift
        self._last_decoding = now
        return now


class PictureOrder(Generic[Picture]):
    """Numbers and judges what the decoder hands out."""

    def __init__(self) -> None:
        self._waiting: dict[int, Sent] = {}  # sent, shown, not yet come: by place, which only grows
        self._times: list[int] = []  # heap of the times of frames that have no number yet
        self._held: deque[tuple[Sent, int, int, bool, Picture]] = deque()
        self._refused: set[int] = set()  # places that were on their way when the decoder refused something
        self._broken: dict[int, int] = {}  # by group, the place from which on it is
        self._last, self._begun = 0, False
        self.times = array("q")  # of every frame that has a number, also of those that never came
        self.hidden = 0  # packets that are no frames

    def sent(self, packet: Sent, *, corrupt: bool = False) -> None:
        """A packet goes to the decoder; `corrupt` where the container knows that bytes are missing."""
        if corrupt:
            self._break(packet)
        self.hidden += not packet.shown
        if packet.shown:
            self._waiting[packet.place] = packet
            heapq.heappush(self._times, packet.time)

    def refused(self) -> None:
        """The decoder refused something that it has been sent."""
        self._refused.update(self._waiting)

    def came(
        self, packet: Sent, picture: Picture, *, corrupt: bool, alone: bool = False, of_fields: bool = False
    ) -> Iterator[Told[Picture]]:
        """A picture came out; those that are now certain, in order.

        alone      whether nothing is predicted from it
        of_fields  whether two packets may have made it
        """
        self._waiting.pop(packet.place, None)
        if corrupt and not alone:
            self._break(packet)
        number = self._numbered(packet, of_fields)
        if number is not None:
            self._give_up_before(packet)
            self._held.append((packet, number, self._last, corrupt, picture))
        yield from self._certain()

    def ended(self) -> Iterator[Told[Picture]]:
        """Nothing more comes; the rest."""
        for place in list(self._waiting):
            self._give_up(place)
        while self._begun and self._times:
            self._count(heapq.heappop(self._times))
        yield from self._certain()

    def _numbered(self, packet: Sent, of_fields: bool) -> int | None:
        """Its number; None for what the decoder hands out twice, or out of order."""
        if not packet.shown or (self._begun and packet.timed and packet.time <= self._last):
            return None
        self._last = packet.time
        if not packet.timed:  # only decoding times are known: their order is that of the pictures too
            self._last = heapq.heappop(self._times)
            self._count(self._last)
        else:
            while self._times and self._times[0] <= packet.time:
                time = heapq.heappop(self._times)
                if time == packet.time or (self._begun and not of_fields):
                    self._count(time)
                else:
                    self.hidden += 1
        self._begun = True
        return len(self.times) - 1

    def _count(self, time: int) -> None:
        if not self.times or self.times[-1] != time:
            self.times.append(time)

    def _give_up_before(self, packet: Sent) -> None:
        for place, other in list(self._waiting.items()):
            if other.time < packet.time and packet.timed:
                self._give_up(place)

    def _give_up(self, place: int) -> None:
        """What should have come before what came will not come; where the decoder refused it, others lack it."""
        packet = self._waiting.pop(place)
        if place in self._refused:
            self._break(packet)
        self._refused.discard(place)

    def _break(self, packet: Sent) -> None:
        self._broken[packet.group] = min(packet.place, self._broken.get(packet.group, packet.place))

    def _certain(self) -> Iterator[Told[Picture]]:
        first = next(iter(self._waiting), None)
        if len(self._held) > MOST_HELD and first is not None:
            self._give_up(first)
            first = next(iter(self._waiting), None)
        while self._held and (first is None or first > self._held[0][0].place):
            packet, number, time, corrupt, picture = self._held.popleft()
            damaged = corrupt or packet.place >= self._broken.get(packet.group, packet.place + 1)
            damaged = damaged or (packet.leading and packet.group - 1 in self._broken)
            yield Told(number=number, time=time, damaged=damaged, picture=picture)
        for group in [g for g in self._broken if self._held and g < self._held[0][0].group - 1]:
            del self._broken[group]
