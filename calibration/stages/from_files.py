"""Stage 1 in one call: photo files in, calibration out. What the command line runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from pathlib import Path

import numpy as np

from calibration.boards.board import Board
from calibration.boards.view import BoardView
from calibration.detection.charuco_mistakes import why_not_found, wrong_marker
from calibration.detection.find import find_board, looks_like
from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError, UsageError
from calibration.judgement.result import Calibration, RejectedView
from calibration.photos.reading import EXPORT, Photo, PhotoFiles, find_photos, read_photo
from calibration.photos.videos import frame_count, video_frames
from calibration.stages.from_views import calibrate, refuse_mixed_sizes

Progress = Callable[[int, int], None]
"""Called with (photos done, photos in all)."""

VIDEO_VIEWS = 30
ASKED_FOR_SIZE = 5


def calibrate_files(
    sources: Sequence[Path],
    board: Board,
    *,
    progress: Progress | None = None,
    terms: str = "auto",
) -> Calibration:
    """The camera that took the photos (files, folders, patterns, videos) of `board`.

    progress  called with (done, total) after each photo
    terms     distortion terms, see `calibrate`
    Raises InputFileError (no photos, unreadable, board in none of them, mixed sizes or cameras), UsageError (the board
    has another number of corners), CalibrationError (the views cannot determine the camera).
    """
    files = find_photos([Path(s) for s in sources])
    _refuse_wrong_count(files, board)
    found, missing = find_views(files, board, progress)
    _refuse_mirrored(files, board, found)
    _refuse_other_charuco(files, board, found)
    _refuse_absent(board, found, missing)
    _refuse_mixed_cameras(found)
    rejected = [RejectedView(name=name, reason="the board was not found") for name in missing]
    rejected += [
        RejectedView(name=path.name, reason=f"{path.suffix} is not read here: {EXPORT}") for path in files.unread
    ]
    return calibrate(found, board, terms=terms, rejected=rejected)


def find_views(files: PhotoFiles, board: Board, progress: Progress | None = None) -> tuple[list[BoardView], list[str]]:
    """The views in which the board was found, and the names of the photos in which it was not."""
    total = len(files.photos) + sum(map(frame_count, files.videos))
    done, found, missing, sizes = 0, [], [], []
    for name, size, view in _looked_at(files.photos, board):
        done += 1
        sizes.append((name, size))
        if view is None:
            missing.append(name)
        else:
            found.append(view)
        if progress is not None:
            progress(done, total)
    for video in files.videos:
        seen = []
        for photo in video_frames(video):
            done += 1
            view = find_board(photo.gray, board, photo.name, taken=photo.taken)
            seen += [] if view is None else [view]
            sizes.append((photo.name, (photo.gray.shape[1], photo.gray.shape[0])))
            if progress is not None:
                progress(min(done, total), total)
        found += spread_out(seen, VIDEO_VIEWS)
        missing += [] if seen else [video.name]
    refuse_mixed_sizes(sizes)
    return found, missing


def _looked_at(paths: Sequence[Path], board: Board) -> Iterator[tuple[str, tuple[int, int], BoardView | None]]:
    """Photos decoded and searched on several threads (OpenCV works outside of Python's lock), in order."""

    def look(path: Path) -> tuple[str, tuple[int, int], BoardView | None]:
        photo: Photo = read_photo(path)
        size = photo.gray.shape[1], photo.gray.shape[0]
        return photo.name, size, find_board(photo.gray, board, photo.name, taken=photo.taken)

    with ThreadPoolExecutor(max_workers=min(4, cpu_count() or 1)) as pool:
        try:
            yield from pool.map(look, paths)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def spread_out(views: Sequence[BoardView], most: int) -> list[BoardView]:
    """At most `most` views, sharp ones that differ: each next one is the furthest from all that were taken.

    Views are compared by where the four outermost corners are, in shares of the image.
    """
    if not views:
        return []
    blur = np.nan_to_num([v.blur_px[1] for v in views], nan=1e9)
    sharp = [v for v, b in zip(views, blur, strict=True) if b <= 1.5 * np.median(blur)]
    place: Floats = np.array([_outermost(v) for v in sharp])
    taken = [int(np.argmin(blur[blur <= 1.5 * np.median(blur)]))]
    nearest = np.linalg.norm(place - place[taken[0]], axis=1)
    while len(taken) < min(most, len(sharp)) and nearest.max() > 0.02:
        taken.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(place - place[taken[-1]], axis=1))
    return [sharp[i] for i in sorted(taken)]


def _outermost(view: BoardView) -> Floats:
    ends = view.corners[[0, -1]] / np.array(view.image_size)
    low, high = view.corners.min(axis=0), view.corners.max(axis=0)
    return np.concatenate([ends.ravel(), low / view.image_size, high / view.image_size])


def _refuse_wrong_count(files: PhotoFiles, board: Board) -> None:
    """Raises UsageError where some photos, asked before all are searched, clearly show a board of another size.

    A grid smaller than the board can be found inside it, so that it was found proves nothing; a larger one cannot.
    """
    if board.marker_m is not None:
        return
    asked = [photo.gray for photo in _some_photos(files)]
    guess = looks_like(asked)
    given = max(board.cols, board.rows), min(board.cols, board.rows)
    if guess is None or guess[0] == given or guess[1] <= 0.5 * guess[2]:
        return
    (cols, rows), _, _ = guess
    other = Board(cols=cols, rows=rows, square_m=board.square_m)
    larger = cols > given[0] or rows > given[1]
    shown = [g for g in asked if find_board(g, other, "") is not None and (larger or find_board(g, board, "") is None)]
    if len(shown) <= 0.5 * len(asked):
        return
    raise UsageError(
        where="--board",
        seen=board.name,
        expected=f"the board in the photos, which looks like {other.name} inner corners "
        f"(in {len(shown)} of {len(asked)} photos asked)",
        advice=f"--board {other.name}; inner corners are the points where four squares meet",
    )


def _refuse_mirrored(files: PhotoFiles, board: Board, found: Sequence[BoardView]) -> None:
    """Raises InputFileError where a ChArUco board is found in mirrored photos only; markers know left from right."""
    if found or board.marker_m is None:
        return
    asked = list(_some_photos(files))
    shown = [p.name for p in asked if find_board(np.ascontiguousarray(p.gray[:, ::-1]), board, p.name) is not None]
    if shown:
        raise InputFileError(
            where=f"photos ({', '.join(shown)})",
            seen=f"a mirrored board: its markers can be read in {len(shown)} of {len(asked)} photos asked, but only "
            "when these are flipped",
            expected="photos as the sensor saw them, of a board printed as it is",
            advice="switch off the camera's mirroring (selfie mode); if the board was printed mirrored, print it again",
        )


def _refuse_other_charuco(files: PhotoFiles, board: Board, found: Sequence[BoardView]) -> None:
    """Raises UsageError where the markers say that the board is another than was described."""
    if board.marker_m is None:
        return
    asked = [photo.gray for photo in _some_photos(files)]
    mistake = wrong_marker(asked[:2], board) if found else why_not_found(asked[:2], board)
    if mistake is not None:
        raise UsageError(where=mistake.where, seen=mistake.seen, expected=mistake.expected, advice=mistake.advice)


def _refuse_absent(board: Board, found: Sequence[BoardView], missing: Sequence[str]) -> None:
    if not found:
        raise InputFileError(
            where=f"{len(missing)} photos ({', '.join(missing[:4])}{' ...' if len(missing) > 4 else ''})",
            seen="the board in none of them",
            expected=f"a {'checkerboard' if board.marker_m is None else 'ChArUco board'} of {board.name} inner corners",
            advice="check --board; the whole board with a white margin must be in the image, sharp and evenly lit"
            if board.marker_m is None
            else "check --board, --dictionary and --marker-mm against what was printed; sharp and evenly lit photos",
        )


def _some_photos(files: PhotoFiles) -> Iterator[Photo]:
    """A few photos, or frames of the first video, spread over the whole."""
    step = max(1, len(files.photos) // ASKED_FOR_SIZE)
    for path in files.photos[::step][:ASKED_FOR_SIZE]:
        yield read_photo(path)
    if not files.photos:
        every = max(1, frame_count(files.videos[0]) // ASKED_FOR_SIZE)
        frames = (photo for i, photo in enumerate(video_frames(files.videos[0])) if i % every == 0)
        yield from (photo for photo, _ in zip(frames, range(ASKED_FOR_SIZE), strict=False))


SAME_IN_ALL = {
    "camera": "camera",
    "serial": "camera (serial number)",
    "focal_mm": "focal length in mm",
    "turned_deg": "way up (degrees by which the pictures are turned; photos as stored, videos as shown)",
    "sample_aspect": "shape of the pixels",
}
"""What all photos of one calibration have in common, as far as they say it."""


def _refuse_mixed_cameras(views: Sequence[BoardView]) -> None:
    """Raises InputFileError where the photos themselves say that camera or zoom changed."""
    for key, what in SAME_IN_ALL.items():
        values = Counter(v.taken[key] for v in views if key in v.taken)
        if len(values) > 1:
            told = "; ".join(f"{value}: {', '.join(_named(views, key, value))}" for value in values)
            raise InputFileError(
                where="photos",
                seen=f"more than one {what}: {told}",
                expected="photos of one camera with one zoom",
                advice="calibrate each group on its own",
            )


def _named(views: Sequence[BoardView], key: str, value: str) -> list[str]:
    names = [v.name for v in views if v.taken.get(key) == value]
    return names[:4] + ([f"{len(names) - 4} more"] if len(names) > 4 else [])
