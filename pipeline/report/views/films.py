"""What each camera showed at the chosen moment: small frames of its video, with the targets marked."""

from __future__ import annotations

import base64

from pipeline.records import Film, Results
from pipeline.report.data import participants
from pipeline.report.text.markup import Html, data_script, tag


def films_figure(results: Results) -> Html:
    """A frame for each camera that has a video, and what `page.js` shows in it; nothing where there are none."""
    if not results.films:
        return Html("")
    frames = [_frame(film) for film in results.films]
    data = data_script("films", [_data(results, film) for film in results.films])
    caption = tag("figcaption", "What the cameras showed at that moment; rings are where targets were tracked.")
    return tag("figure", tag("div", *frames, class_="films"), data, caption)


def _frame(film: Film) -> Html:
    image = tag(
        "img", src=_source(film.jpeg[0]), width=film.size[0], height=film.size[1],
        alt=f"Frame of {film.camera} at the chosen moment",
    )  # fmt: skip
    marks = tag("svg", "", viewBox=f"0 0 {film.size[0]} {film.size[1]}", aria_hidden="true")
    head = tag("h4", film.camera, " ", tag("small", "", class_="when"))
    return tag("div", head, tag("div", image, marks, class_="still"), class_="film", data_camera=film.camera)


def _data(results: Results, film: Film) -> dict[str, object]:
    order = participants.targets(results)
    return {
        "camera": film.camera,
        "frame": list(film.frame),
        "t": [round(t, 3) for t in film.time_s],
        "src": [base64.b64encode(jpeg).decode("ascii") for jpeg in film.jpeg],
        "marks": [
            [
                [name, order.index(name) % participants.COLOURS if name in order else -1,
                 round(x * film.size[0], 1), round(y * film.size[1], 1)]
                for name, x, y in marks
            ]
            for marks in film.marks
        ],
    }  # fmt: skip


def _source(jpeg: bytes) -> str:
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode('ascii')}"
