"""Drawn flights with strangers and unknown clocks: how many pairs are found, how many wrong ones are told.

usage: python -m scripts.validation.check_match [--flights 100] [--first-seed 0] [--verbose]

Each flight: 2 to 4 cameras, 3 to 12 targets each, half of them strangers to every other camera; clocks unknown within
30 s; attitudes wrong by 0.5 degrees throughout. A pair counts where both cameras see the target for five seconds at the
same time. Told are pairs with a margin; doubtful ones are left apart, and said. Of the pairs told: how many are wrong
("wrong ones without a warning"). Of the true pairs: how many are told, and how many are told or named as doubtful; the
same by kind of place, and by whether both tracks may be of something that stands still. Last: what lower and higher
margins would tell.
"""

from __future__ import annotations

import argparse
import time

from pipeline.matching import MatchSettings, match_tracks
from pipeline.matching.sampling import sampled
from scripts.validation.drawn_strangers import draw
from scripts.validation.figures import tell


def pair_of(pair):
    """As the truth has it."""
    return tuple(sorted(((pair.first.camera, pair.first.target), (pair.second.camera, pair.second.target))))


def standing(cameras, settings):
    """Tracks (camera, name) that may be of something that stands still."""
    views = [sampled(camera, settings) for camera in cameras]
    return {(v.camera, name) for v in views for name, still in zip(v.names, v.still, strict=True) if still}


def main() -> None:
    """Prints a line for each flight and the figures of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--verbose", action="store_true")
    arguments = parser.parse_args()
    sums = dict.fromkeys(("true", "told_right", "told_wrong", "named_right", "named_wrong"), 0)
    margins, begin = [], time.process_time()
    settings, parts = MatchSettings(search_s=30.0), {}
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.flights):
        flight = draw(seed)
        if len(flight.cameras) < 2:
            continue
        now = time.process_time()
        found = match_tracks(flight.cameras, settings)
        took = time.process_time() - now
        true = {tuple(sorted(pair)) for pair in flight.pairs}
        ever = {tuple(sorted(pair)) for pair in flight.ever}
        told = {pair_of(p): p.margin for p in found.pairs}
        named = {pair_of(d.pair): d.pair.margin for d in found.doubtful}
        one = {
            "true": len(true),
            "told_right": len(true & set(told)),
            "told_wrong": len(set(told) - ever),
            "named_right": len(true & set(named)),
            "named_wrong": len(set(named) - ever),
        }
        still = standing(flight.cameras, settings)
        for pair in true:
            for part in (flight.kind, "standing" if set(pair) <= still else "moving"):
                parts.setdefault(part, []).append((pair in told, pair in named))
        margins += [(m, p in ever, seed) for p, m in {**told, **named}.items()]
        for key, value in one.items():
            sums[key] += value
        off = {
            c.camera: "?" if c.offset_s is None else f"{c.offset_s - flight.offset_s[c.camera]:+.2f}/{c.sigma_s:.2f}"
            for c in found.clocks[1:]
        }
        print(f"{seed:4d} {flight.kind:18s} {one} clocks {off} {took:.1f} s", flush=True)
        if arguments.verbose:
            for pair in sorted(true - set(told)):
                print("     missed", pair, "named" if pair in named else "")
            for pair in sorted(set(told) - ever):
                print("     WRONG ", pair, f"{told[pair]:.1f}")
    seconds = time.process_time() - begin
    figures = {
        "flights": arguments.flights,
        "true_pairs": sums["true"],
        "right_share": sums["told_right"] / max(sums["true"], 1),
        "right_or_named_share": (sums["told_right"] + sums["named_right"]) / max(sums["true"], 1),
        "wrong_share": sums["told_wrong"] / max(sums["told_right"] + sums["told_wrong"], 1),
        "seconds_per_flight": seconds / arguments.flights,
    }
    print(figures)
    for part, of in sorted(parts.items()):
        right, doubted = (sum(one[k] for one in of) for k in (0, 1))
        print(
            f"{part}: {len(of)} true pairs, told {right / len(of):.2f}, told or named {(right + doubted) / len(of):.2f}"
        )
    for at in (3, 4, 5, 6, 7, 8):
        above = [right for m, right, _ in margins if m >= at]
        print(f"margin {at}: told {len(above)}, wrong {len(above) - sum(above)}")
    tell({f"match_{key}": value for key, value in figures.items()})


if __name__ == "__main__":
    main()
