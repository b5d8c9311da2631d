"""The label page served on this machine and used in a real browser: draw a box, save, pair, delete, track."""

from __future__ import annotations

import json
import re
import threading
import tomllib
import urllib.error
import urllib.request
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.export import read_tracks_csv
from pipeline.label import LabelSession, label_server, page_text
from pipeline.records import Box
from pipeline.synthetic.moving_cars import first_box, render, scene, truth, write
from tests.integration.report.test_report_browser import BROWSER, browse_address

FRAMES, SIZE = 40, (480, 320)
FLIGHT = """# a flight under the label page
[cameras.uav1]
calibration = "none.json"
video = "one.avi"     # the first

[cameras."uav 2"]
calibration = "none.json"
video = "two.avi"
"""


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    made = scene(31, frames=110, size=SIZE, lengths=(22, 34), hidden=(0, 0))
    folder = tmp_path_factory.mktemp("videos")
    write(islice(render(made), FRAMES), folder / "one.avi", codec="MJPG")
    return made, folder / "one.avi"


@pytest.fixture
def flight(rendered, tmp_path) -> Path:
    (tmp_path / "one.avi").hardlink_to(rendered[1])
    (tmp_path / "two.avi").write_bytes(rendered[1].read_bytes() + bytes(8))  # one recording twice would be refused
    path = tmp_path / "flight.toml"
    path.write_text(FLIGHT)
    return path


@pytest.fixture
def serve(flight):
    """Starts the server on a page; ends it with the test."""
    session = LabelSession(flight, flight.parent / "out")
    running = []

    def start(page: str | None = None) -> str:
        server = label_server(session, page=page)
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True)
        thread.start()
        running.append((server, thread))
        return server.address

    yield start
    for server, thread in running:
        server.shutdown()
        thread.join()
        server.server_close()
    session.close()


USE_IT = """
<script>
(async () => {
  const pause = () => new Promise((go) => setTimeout(go, 20));
  const wait = async (good) => { for (let k = 0; k < 400 && !good(); k += 1) await pause(); };
  const drag = async (pane, [x, y, w, h]) => {
    const words = document.getElementById("words");
    words.textContent = "";
    const seen = pane.canvas.getBoundingClientRect(), unit = seen.width / pane.canvas.width, view = pane.view;
    const at = (kind, px, py) => pane.canvas.dispatchEvent(new PointerEvent(kind, { pointerId: 1, bubbles: true,
      clientX: seen.left + (px - view.x) * view.zoom * unit, clientY: seen.top + (py - view.y) * view.zoom * unit }));
    pane.canvas.setPointerCapture = () => {};
    at("pointerdown", x, y); at("pointermove", x + w / 2, y + h); at("pointerup", x + w, y + h);
    await wait(() => words.textContent !== "");
  };
  await wait(() => document.documentElement.dataset.ready && panes.every((p) => p.picture.naturalWidth));
  const done = [];
  const choose = (pane, name) => { pane.target.value = name; pane.target.dispatchEvent(new Event("change")); };
  choose(panes[0], "target1");
  const seen = panes[0].canvas.getBoundingClientRect(), unit = seen.width / panes[0].canvas.width;
  const [bx, by, bw, bh] = BOXES[0];
  const clientX = seen.left + (bx + bw / 2) * unit, clientY = seen.top + (by + bh / 2) * unit;
  const wheel = () =>
    panes[0].canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -500, cancelable: true, clientX, clientY }));
  wheel();
  done.push(panes[0].view.zoom);
  panes[0].canvas.focus();
  wheel();
  done.push(panes[0].view.zoom > 2 && panes[0].view.x > 0);
  await drag(panes[0], BOXES[0]);
  const moved = panes[0].view.x;
  for (const [kind, x] of [["pointerdown", 0], ["pointermove", 20], ["pointerup", 20]])
    panes[0].canvas.dispatchEvent(
      new PointerEvent(kind, { pointerId: 1, shiftKey: true, clientX: clientX + x, clientY }));
  done.push(panes[0].view.x < moved && panes[0].drag === null);
  panes[0].canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "0" }));
  done.push(panes[0].view.zoom);
  choose(panes[0], "target2");
  await drag(panes[0], BOXES[1]);
  choose(panes[1], "target1");
  await drag(panes[1], BOXES[1]);
  choose(panes[1], "target2");
  await drag(panes[1], BOXES[0]);
  choose(panes[1], "target3");
  await drag(panes[1], [10, 10, 30, 30]);
  done.push(state.targets.length);
  panes[1].remove("target3");
  await wait(() => state.targets.length === 2);
  done.push(state.targets.length);
  const is = panes[1].list.querySelector("select");
  is.value = "target2";
  is.dispatchEvent(new Event("change"));
  await wait(() => Math.abs(panes[1].boxes()[0].box[0] - BOXES[0][0]) < 1);
  document.getElementById("track").click();
  await wait(() => document.documentElement.dataset.tracked);
  done.push(document.documentElement.dataset.tracked);
  panes[0].go(20);
  await wait(() => panes[0].picture.complete && panes[0].picture.src.endsWith("index=20"));
  document.documentElement.setAttribute("data-used", done.join(" "));
})();
</script>
"""


@pytest.mark.browser
@pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome on the path")
def test_a_person_draws_boxes_pairs_them_and_tracks(rendered, flight, serve, tmp_path):
    made, _ = rendered
    boxes = [first_box(made, car) for car in made.cars]
    drawn = [[box.x, box.y, box.width, box.height] for box in boxes]
    use = USE_IT.replace("BOXES", json.dumps(drawn))
    shot = ("--dump-dom", "--virtual-time-budget=60000")
    page, console = browse_address(serve(page_text().replace("</body>", use + "</body>")), tmp_path / "profile", *shot)
    assert console == ""
    assert re.search(r'data-used="([^"]*)"', page)[1].split() == ["1", "true", "true", "1", "3", "2", "4"]
    text = flight.read_text()
    assert text.startswith(FLIGHT)
    targets = tomllib.loads(text)["targets"]
    assert list(targets) == ["target1", "target2"]
    for name, sides in zip(targets, drawn, strict=True):
        for camera in ("uav1", "uav 2"):
            assert targets[name]["boxes"][camera]["frame"] == 0
            np.testing.assert_allclose(targets[name]["boxes"][camera]["box"], sides, atol=0.8)
    tracks = read_tracks_csv(flight.parent / "out" / "tracks.csv")
    assert [(t.camera, t.target) for t in tracks] == [
        ("uav1", "target1"), ("uav1", "target2"), ("uav 2", "target1"), ("uav 2", "target2"),
    ]  # fmt: skip
    for track, car, box in zip(tracks, made.cars * 2, boxes * 2, strict=True):
        true_px, _ = truth(made, car, box)
        assert np.abs(track.xy_px[track.seen] - true_px[:FRAMES][track.seen]).max() < 1.0


def asked(address: str, path: str = "", body: object = None, *, token: str | None = None, **headers: str):
    """The answer to a request of the page's, or to one with another secret or other headers."""
    base, _, own = address.partition("?token=")
    secret = own if token is None else token
    data = None if body is None else body if isinstance(body, bytes) else json.dumps(body).encode()
    headers = ({"X-Runningfix": secret} if data is not None else {}) | headers
    url = f"{base}{path}{'&' if '?' in path else '?'}token={secret}" if data is None else base + path
    try:
        with urllib.request.urlopen(urllib.request.Request(url, data, headers), timeout=120) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()


def test_only_this_page_on_this_machine_is_answered(flight, serve):
    address = serve()
    assert address.startswith("http://127.0.0.1:")
    assert asked(address)[0] == 200
    assert asked(address, Host="evil.example")[0] == 403
    box = {"act": "set", "camera": "uav1", "target": "t", "frame": 0, "box": [5, 5, 20, 20]}
    for path in ("", "state", "tracks?camera=uav1", "progress?after=-1", "frame?camera=uav1&index=0"):
        assert asked(address, path, token="")[0] == 403
        assert asked(address, path, token="1")[0] == 403
    assert asked(address, "change", box, token="")[0] == 403
    assert asked(address, "change", box, token="1")[0] == 403
    assert asked(address, "change", box, Host="evil.example")[0] == 403
    assert flight.read_text() == FLIGHT
    assert asked(address, "change", box)[0] == 200
    assert flight.read_text() == FLIGHT + "\n[targets.t]\nboxes.uav1 = { frame = 0, box = [5, 5, 20, 20] }\n"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"frame": 40}, "0 to 39"),
        ({"box": [470, 5, 20, 20]}, "inside 480 x 320"),
        ({"box": [5, 5, 1, 1]}, "at least 4 x 4"),
        ({"box": [5, 5, float("nan"), 9]}, "at least 4 x 4"),
        ({"camera": "uav3"}, "one of uav1, uav 2"),
        ({"target": " "}, "without a name"),
        ({"box": "all"}, "cannot be read"),
        ({"act": "delete"}, "no box"),
        ({"act": "swap", "with": ""}, "another target"),
    ],
)
def test_what_cannot_be_saved_is_said_and_the_file_left(flight, serve, change, said):
    box = {"act": "set", "camera": "uav1", "target": "t", "frame": 0, "box": [5, 5, 20, 20]} | change
    status, answer = asked(serve(), "change", box)
    assert status == 400
    assert said in json.loads(answer)["error"]
    assert flight.read_text() == FLIGHT


def test_frames_are_the_videos_own_in_any_order(rendered, serve):
    address, made = serve(), rendered[0]
    rows = list(islice(render(made), FRAMES))
    for index in (30, 3, 4, 39, 0):
        status, jpeg = asked(address, f"frame?camera=uav%202&index={index}")
        assert status == 200
        shown = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR).astype(float)
        off = [np.abs(shown - rows[k]).mean() for k in range(max(0, index - 1), min(FRAMES, index + 2))]
        assert int(np.argmin(off)) + max(0, index - 1) == index
    assert asked(address, "frame?camera=uav1&index=40")[0] == 404
    assert asked(address, "nowhere")[0] == 404


@pytest.mark.parametrize(
    "body",
    [
        b"", b"[]", b"3", b"null", b"\xff\xfe", b"[" * 60_000,
        b'{"act": "set", "box": [1e999, 0, 9, 9], "frame": 1e999}',
        b'{"act": "set", "camera": "uav1", "target": "t", "frame": ' + b"9" * 5000 + b', "box": [5, 5, 20, 20]}',
        b'{"act": "set", "camera": "uav1", "target": "' + b"t" * 5000 + b'", "frame": 0, "box": [5, 5, 20, 20]}',
        b'{"act": "set", "camera": "uav1", "target": "a\\nb", "frame": 0, "box": [5, 5, 20, 20]}',
        b'{"act": "set", "camera": ["uav1"], "target": {}, "frame": 0, "box": {}}',
        b'{"act": "set", "camera": "uav1", "target": "\\ud800", "frame": 0, "box": [5, 5, 20, 20]}',
        b'{"act": "fly", "camera": "uav1", "target": "t"}',
        b'{"act": "swap", "camera": "nowhere", "target": "t", "with": "u"}',
    ],
)  # fmt: skip
def test_bad_requests_are_survived_and_the_file_left(flight, serve, body):
    address = serve()
    status, answer = asked(address, "change", body)
    assert status in (400, 403)
    assert status == 403 or json.loads(answer)["error"]
    assert flight.read_text() == FLIGHT
    assert asked(address, "state")[0] == 200
    for path in (
        "frame?camera=uav1&index=" + "9" * 400,
        "frame?camera=%ff&index=0",
        "progress?after=x",
        "tracks?camera=",
    ):
        assert asked(address, path)[0] in (200, 404)


def test_a_file_broken_by_hand_is_said_and_left(flight, serve):
    address = serve()
    box = {"act": "set", "camera": "uav1", "target": "t", "frame": 0, "box": [5, 5, 20, 20]}
    for broken in (FLIGHT + "[targets.", "targets = 3\n" + FLIGHT, "\x00"):
        flight.write_text(broken)
        for status, answer in (asked(address, "change", box), asked(address, "state")):
            assert status == 400
            assert "flight.toml" in json.loads(answer)["error"]
        assert flight.read_text() == broken


def test_links_marks_and_permissions_stay(flight, tmp_path):
    kept = tmp_path / "kept.toml"
    kept.write_bytes(b"\xef\xbb\xbf" + FLIGHT.encode())
    kept.chmod(0o640)
    flight.unlink()
    flight.symlink_to(kept)
    session = LabelSession(flight, tmp_path / "out")
    session.set_box("t", "uav1", Box(frame=0, x=5, y=5, width=20, height=20))
    session.close()
    assert flight.is_symlink()
    assert kept.stat().st_mode & 0o777 == 0o640
    assert kept.read_bytes().startswith(b"\xef\xbb\xbf" + FLIGHT.encode())
    assert "[targets.t]" in kept.read_text("utf-8-sig")
