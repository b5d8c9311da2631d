"""Numbers and damage of pictures, told from the order in which packets went to a decoder that is played here."""

from __future__ import annotations

from calibration.foundation.decode_order import MOST_HELD, PacketOrder, PictureOrder

# decoding order, as times shown: I0 P3 B1 B2 P6 B4 B5 | I9 B7 B8 (open group) P12 B10 B11
TIMES = [0, 3, 1, 2, 6, 4, 5, 9, 7, 8, 12, 10, 11]
KEYS = {0, 7}


def played(*, corrupt=(), refused=(), discard=(), alone=(), times=TIMES):
    """(number, time, damaged) of what comes out; `refused` packets make no picture."""
    packets, pictures, told, waiting = PacketOrder(0.04, 0.04), PictureOrder(), [], {}
    for place, time in enumerate(times):
        sent = packets.sent(time, place - 3, key=place in KEYS, discard=place in discard)
        pictures.sent(sent)
        if place in refused:
            pictures.refused()
        elif sent.shown:
            waiting[time] = (place, sent)
        while waiting and min(waiting) <= place - 3:
            place_out, out = waiting.pop(min(waiting))
            told += pictures.came(out, place_out, corrupt=place_out in corrupt, alone=place_out in alone)
    for time in sorted(waiting):
        place_out, out = waiting[time]
        told += pictures.came(out, place_out, corrupt=place_out in corrupt, alone=place_out in alone)
    told += pictures.ended()
    return [(t.number, t.time, t.damaged) for t in told]


def damaged(found):
    return {number for number, _, hurt in found if hurt}


def test_sound_pictures_come_in_order_with_their_numbers():
    assert played() == [(k, k, False) for k in range(13)]


def test_a_picture_waits_for_what_it_was_predicted_from():
    assert damaged(played(corrupt={1})) == {
        1,
        2,
        3,
        4,
        5,
        6,
        7,
        8,
    }  # and the open group
    assert damaged(played(corrupt={4})) == {4, 5, 6, 7, 8}


def test_damage_ends_at_a_key_frame():
    assert damaged(played(corrupt={10})) == {10, 11, 12}
    assert damaged(played(corrupt={2}, alone={2})) == {1}


def test_what_the_decoder_refused_is_missing_and_harms_what_needs_it():
    found = played(refused={4})
    assert [number for number, _, _ in found] == [0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12]
    assert damaged(found) == {4, 5, 7, 8}


def test_what_is_cut_away_has_no_number():
    found = played(discard={0, 2})
    assert found == [(k, time, False) for k, time in enumerate([2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12])]


def test_what_never_comes_holds_nothing_up_for_ever():
    packets, pictures, told = PacketOrder(0.04, 0.04), PictureOrder(), []
    pictures.sent(packets.sent(10_000, 0, key=True, discard=False))
    for k in range(1, 200):
        sent = packets.sent(k, k, key=False, discard=False)
        pictures.sent(sent)
        told += pictures.came(sent, None, corrupt=False)
    assert len(told) >= 199 - MOST_HELD - 1


def test_a_clock_that_begins_anew_goes_on():
    packets = PacketOrder(0.04, 0.04)
    times = [packets.sent(t, t, key=t == 0, discard=False).time for t in [*range(50), *range(50)]]
    assert times == list(range(100))
    assert packets.joins == 1


def test_a_container_without_times_counts():
    packets, pictures, told = PacketOrder(0.04, 0.04), PictureOrder(), []
    sent = [packets.sent(None, None, key=k == 0, discard=False) for k in range(4)]
    for packet in sent:
        pictures.sent(packet)
    for packet in (sent[0], sent[2], sent[1], sent[3]):
        told += pictures.came(packet, None, corrupt=False)
    assert [(t.number, t.time) for t in told] == [(0, 0), (1, 1), (2, 2), (3, 3)]
