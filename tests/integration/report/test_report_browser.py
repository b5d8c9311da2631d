"""The page in a real browser: its scripts run without a complaint and something is drawn."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.report import render_report
from tests.scenes.report import fake_results, with_films

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
BROWSER = next((found for found in map(shutil.which, NAMES) if found), None)
QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars",
    "--virtual-time-budget=3000", "--enable-logging=stderr",
)  # fmt: skip

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome on the path"),
]


def browse(page: Path, profile: Path, *options: str) -> tuple[str, str]:
    """What the browser prints, and what its console says."""
    return browse_address(page.as_uri(), profile, *options)


def browse_address(address: str, profile: Path, *options: str) -> tuple[str, str]:
    """The same of a page that is served."""
    command = [str(BROWSER), *QUIET, f"--user-data-dir={profile}", *options, address]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return done.stdout, "\n".join(console)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(render_report(with_films(fake_results(seconds=8))), encoding="utf-8")
    return path


def test_the_scripts_run_without_a_complaint(report, tmp_path):
    page, console = browse(report, tmp_path, "--dump-dom")
    assert console == ""
    assert re.search(r'<html[^>]* data-ready="true"', page)
    assert re.search(r'<span id="space-words">Grid of \d+ m', page)


def test_a_script_that_fails_would_be_noticed(report, tmp_path):
    broken = tmp_path / "broken.html"
    broken.write_text(report.read_text(encoding="utf-8").replace("const views = {", "const views = missing + {"))
    page, console = browse(broken, tmp_path / "profile", "--dump-dom")
    assert "missing is not defined" in console
    assert 'data-ready="true"' not in page


EVEN_FRAMES = "<script>window.requestAnimationFrame = (go) => setTimeout(() => go(performance.now()), 16);</script>"
USE_IT = """
<script>
const canvas = document.getElementById("space"), slider = document.getElementById("moment");
const chart = document.querySelector("svg[data-t0]"), done = [];
const look = () => canvas.toDataURL();
const films = () => [...document.querySelectorAll(".film")];
const stills = () => films().map((f) => f.querySelector("img").src + f.querySelector(".when").textContent).join();
const grounds = () => [...document.querySelectorAll("image.ground")];
const ground = () => grounds().map((g) => getComputedStyle(g).display).join();
const wait = () => new Promise((go) => setTimeout(go, 60));
const point = (kind, x, y) =>
  canvas.dispatchEvent(new PointerEvent(kind, { pointerId: 1, clientX: x, clientY: y, bubbles: true }));
canvas.setPointerCapture = () => {};
const steps = {
  slider: () => { slider.value = 6; slider.dispatchEvent(new Event("input")); },
  drag: () => { point("pointerdown", 300, 300); point("pointermove", 360, 330); point("pointerup", 360, 330); },
  key: () => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" })),
  wheel: () => { canvas.focus(); canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: 120, cancelable: true })); },
  above: () => document.querySelector('[data-view="top"]').click(),
  targets: () => document.querySelector('[data-view="targets"]').click(),
  picture: () => document.querySelector("[data-moment]").click(),
  hide: () => document.querySelector('[data-show="uncertainty"]').click(),
};
(async () => {
  await wait();
  const still = stills(), shown = ground();
  for (const [name, step] of Object.entries(steps)) {
    const before = look();
    step();
    await wait();
    if (look() !== before) done.push(name);
  }
  const box = chart.getBoundingClientRect();
  chart.dispatchEvent(new PointerEvent("pointermove", { clientX: box.left + box.width / 2, clientY: box.top + 50 }));
  const at = chart.querySelector(".moment").getAttribute("x1"), dot = document.querySelector(".map .now");
  document.getElementById("ground").click();
  const moved = stills() !== still && document.querySelectorAll(".film circle").length > 0;
  const hidden = shown.includes("inline") && !ground().includes("inline");
  const words = [...done, +slider.value, at > 0, dot.getAttribute("cx") > 0, moved, hidden].join(" ");
  document.documentElement.setAttribute("data-used", words);
})();
</script>
"""


def test_slider_mouse_and_keys_move_the_page(report, tmp_path):
    used = tmp_path / "used.html"
    text = report.read_text(encoding="utf-8")
    used.write_text(text.replace("<body>", "<body>" + EVEN_FRAMES).replace("</body>", USE_IT + "</body>"))
    page, console = browse(used, tmp_path / "profile", "--dump-dom")
    assert console == ""
    words = re.search(r'data-used="([^"]*)"', page)[1].split()
    assert words[:8] == ["slider", "drag", "key", "wheel", "above", "targets", "picture", "hide"]
    assert 3 < float(words[8]) < 5.5
    assert words[9:] == ["true"] * 4


@pytest.mark.parametrize("width", [1280, 400])
def test_something_is_drawn(report, tmp_path, width):
    shot = tmp_path / "shot.png"
    browse(report, tmp_path / "profile", f"--screenshot={shot}", f"--window-size={width},3000")
    image = cv2.imread(str(shot))
    assert image.shape == (3000, width, 3)
    assert all(len(np.unique(part.reshape(-1, 3), axis=0)) > 20 for part in np.array_split(image[:2400], 3))


def test_dark_is_dark(report, tmp_path):
    shot = tmp_path / "shot.png"
    browse(report, tmp_path / "profile", f"--screenshot={shot}", "--window-size=800,600", "--force-dark-mode")
    assert np.median(cv2.imread(str(shot))) < 60


WIDE = """
<script>
const over = [...document.body.querySelectorAll("*")].filter((e) => {
  const box = e.getBoundingClientRect();
  const inside = e.closest("nav, svg, .sr, thead, .scroll");
  return box.width > 0 && !(inside && inside !== e) && box.right > document.documentElement.clientWidth + 0.5;
});
const rows = [...document.querySelectorAll(".scroll")].filter((e) => e.scrollWidth > e.clientWidth + 1);
document.documentElement.setAttribute("data-wide", document.documentElement.clientWidth);
document.documentElement.setAttribute("data-over", [...over, ...rows].map((e) => e.tagName + e.className).join(" "));
</script>
"""


@pytest.mark.parametrize("width", [390, 1400])
def test_nothing_is_cut_off(report, tmp_path, width):
    shown = tmp_path / "shown.html"
    shown.write_text(report.read_text(encoding="utf-8").replace("</body>", WIDE + "</body>"))
    page, console = browse(shown, tmp_path / "profile", "--dump-dom", f"--window-size={width},2000")
    assert console == ""
    assert int(re.search(r'data-wide="(\d+)"', page)[1]) <= max(width, 500)
    assert re.search(r'data-over="([^"]*)"', page)[1] == ""
