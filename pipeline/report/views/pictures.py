"""Pictures from the videos: each target's first fix in each camera, outliers, losses; what was tracked is marked."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence

from pipeline.records import Picture, Results
from pipeline.report.blocks import key, note, swatch
from pipeline.report.data import participants
from pipeline.report.text.markup import Html, joined, number, tag
from pipeline.report.text.words import SIGMA, fixed, rounded, whole

SIDE = 160.0
"""Of a picture on the page, in the units in which its marks are drawn."""
INNER, OUTER, RING = 11.0, 25.0, 7.0


def pictures_section(results: Results) -> Html:
    """Three groups of pictures, and what is missing; nothing where there are none."""
    shown = results.pictures
    if not shown:
        return Html("")
    first = [p for p in shown if p.kind == "first"]
    losses = _pairs(p for p in shown if p.kind in ("lost", "found"))
    outliers = [p for p in shown if p.kind == "outlier"]
    parts = [_key(), tag("h3", "Each target's first fix in each camera"), _gallery(_of_targets(results, first))]
    if outliers:
        parts += [tag("h3", "Outliers"), _gallery(_of_cameras(results, outliers))]
    if losses:
        parts += [tag("h3", "Lost, and found again"), _gallery(_loss(results, pair) for pair in losses)]
    return joined(*parts, *(note(words) for words in results.picture_notes))


def pictures_missing(results: Results) -> Html:
    """Why there are no pictures, where there are none."""
    return joined(*(note(words) for words in results.picture_notes)) if not results.pictures else Html("")


def _key() -> Html:
    keys = (
        key("mark-fix", "where it was tracked", "M1 6H9M15 6H23M12 0V3M12 9V12"),
        key("mark-box", "the box that was drawn", "M6 1H18V11H6Z"),
        key("mark-solved", "where the solution has it", "M7 6A5 5 0 1 0 17 6A5 5 0 1 0 7 6"),
    )
    return tag("ul", *(tag("li", k) for k in keys), class_="legend c-ink")


def _gallery(groups: Iterable[Html]) -> Html:
    return tag("div", *groups, class_="gallery")


def _group(heading: Html, shots: Sequence[Html]) -> Html:
    return tag("div", tag("h4", heading), tag("div", *shots, class_="shots"), class_="group")


def _of_targets(results: Results, first: Sequence[Picture]) -> list[Html]:
    """A target's pictures from all cameras side by side: it should be the same thing."""
    names = dict.fromkeys([*participants.targets(results), *(p.target for p in first)])
    groups = []
    for name in names:
        own = [_shot(results, p) for p in first if p.target == name]
        if own:
            groups.append(_group(_name(results, name), own))
    return groups


def _of_cameras(results: Results, shown: Sequence[Picture]) -> list[Html]:
    """A camera's outliers together, the largest first."""
    cameras = dict.fromkeys(p.camera for p in shown)
    return [_group(tag("span", c), [_shot(results, p) for p in shown if p.camera == c]) for c in cameras]


def _name(results: Results, target: str) -> Html:
    known = target in participants.targets(results)
    return swatch(results, target) if known else tag("span", target)


def _whose(results: Results, of: Picture) -> Html:
    return joined(_name(results, of.target), f" in {of.camera}")


def _pairs(shown: Iterable[Picture]) -> list[list[Picture]]:
    """Each loss with what came after it, where both are there."""
    pairs: list[list[Picture]] = []
    for p in sorted(shown, key=lambda p: (p.camera, p.target, p.frame)):
        last = pairs[-1][-1] if pairs else None
        begun = last is not None and last.kind == "lost" and (last.camera, last.target) == (p.camera, p.target)
        if p.kind == "found" and begun:
            pairs[-1].append(p)
        else:
            pairs.append([p])
    return pairs


def _loss(results: Results, pair: Sequence[Picture]) -> Html:
    gap = pair[-1].time_s - pair[0].time_s
    lost = f", lost for {rounded(gap)}\u00a0s" if len(pair) == 2 and math.isfinite(gap) else ""
    return _group(joined(_whose(results, pair[0]), lost), [_shot(results, p) for p in pair])


def _shot(results: Results, of: Picture) -> Html:
    """A picture with its marks and what they say."""
    width, height = of.size
    scale = SIDE / max(width, height, 1)
    encoded = base64.b64encode(of.jpeg).decode("ascii")
    image = tag("image", href=f"data:image/jpeg;base64,{encoded}", width=width * scale, height=height * scale)
    words = f"{of.target} in {of.camera}, frame {of.frame}: {_kind(of)}{_residual(of, ', ')}"
    tone = participants.tone(results, of.target) if of.target in participants.targets(results) else "c-ink"
    drawing = tag(
        "svg", tag("title", words), image, tag("g", *_marks(of, scale), class_=tone), role="img", class_="shot",
        viewBox=f"0 0 {number(width * scale)} {number(height * scale)}",
    )  # fmt: skip
    return tag("figure", drawing, tag("figcaption", *_caption(results, of)), class_="cut")


def _kind(of: Picture) -> str:
    return {
        "first": "its first fix",
        "outlier": "an outlier",
        "lost": "its last fix before it was lost",
        "found": "the fix that found it again",
    }[of.kind]


def _caption(results: Results, of: Picture) -> list[Html]:
    plain = {"first": of.camera, "lost": "last fix", "found": "found again"}
    title: str = _name(results, of.target) if of.kind == "outlier" else plain[of.kind]
    moment = f"frame {whole(of.frame)}"
    time: list[Html] = []
    if math.isfinite(of.time_s):
        time = [
            joined(", "),
            tag("button", f"{fixed(of.time_s, 2)}\u00a0s", type="button", data_moment=f"{of.time_s:.4f}"),
        ]
    return [tag("span", title, class_="what"), tag("span", moment, *time), tag("span", _residual(of))]


def _residual(of: Picture, lead: str = "") -> str:
    if not (math.isfinite(of.residual_px) and math.isfinite(of.residual_sigma)):
        return "" if lead else "took no part"
    words = f"{rounded(of.residual_px)}\u00a0px off, {fixed(of.residual_sigma, 1)}{SIGMA}"
    weight = f", weight {fixed(of.weight, 2)}" if of.weight < 0.995 else ""
    return f"{lead}{words}{weight}"


def _marks(of: Picture, scale: float) -> list[Html]:
    """Everything twice: a dark edge under it, so that it is seen on any ground."""
    drawn: list[tuple[str, str]] = []
    x, y = (v * scale for v in of.place(of.fix_px))
    if of.box_px is not None:
        left, top = (v * scale for v in of.place((of.box_px[0], of.box_px[1])))
        wide, high = (v * scale * of.zoom for v in of.box_px[2:])
        drawn.append((f"M{_at(left, top)}h{number(wide)}v{number(high)}h{number(-wide)}Z", "mark-box"))
    if of.kind != "first" and all(map(math.isfinite, of.predicted_px)):
        px, py = (v * scale for v in of.place(of.predicted_px))
        if math.hypot(px - x, py - y) > RING:
            drawn.append((f"M{_at(x, y)}L{_at(px, py)}", "mark-way"))
        turn = f"A{RING} {RING} 0 1 0"
        drawn.append((f"M{_at(px - RING, py)}{turn} {_at(px + RING, py)}{turn} {_at(px - RING, py)}", "mark-solved"))
    drawn.append((_reticle(x, y), "mark-fix"))
    return [tag("path", d=d, class_=c) for d, name in drawn for c in (f"{name} under", name)]


def _reticle(x: float, y: float) -> str:
    arms = ((-OUTER, 0, -INNER, 0), (INNER, 0, OUTER, 0), (0, -OUTER, 0, -INNER), (0, INNER, 0, OUTER))
    return "".join(f"M{_at(x + a, y + b)}L{_at(x + c, y + d)}" for a, b, c, d in arms)


def _at(x: float, y: float) -> str:
    return f"{number(x, 1)} {number(y, 1)}"
