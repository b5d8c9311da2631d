"use strict";
// The 3D view. World: ENU metres. View: x right, y up, z towards the eye; perspective screen = focal * x / depth.
// Uncertainty is exact: the silhouette of a 3D ellipsoid with covariance C is the 2D ellipse J C J'.
const makeSpace = (canvas, flight) => {
  const pen = canvas.getContext("2d");
  const show = { uncertainty: true, sights: true, truth: true };
  const eye = { yaw: -0.6, pitch: 0.55, distance: 100, at: [0, 0, 0] };
  let now = flight.time[0], width = 0, height = 0, axes = [], tint = {};

  const points = { targets: flight.targets.flatMap(({ p, guess }) => { const out = new Set(guess); return p.filter((_, i) => !out.has(i)); }), cameras: flight.cameras.flatMap((c) => c.p) };
  points.all = points.targets.concat(points.cameras);
  const bounds = (list) => [0, 1, 2].map((k) => list.reduce((m, p) => [Math.min(m[0], p[k]), Math.max(m[1], p[k])], [Infinity, -Infinity]));
  const ground = points.targets.length ? bounds(points.targets)[2][0] : points.all.length ? bounds(points.all)[2][0] : 0;

  const move = (dx, dy) => {
    const scale = eye.distance / focal();
    eye.at = eye.at.map((v, k) => v - scale * dx * axes[0][k] + scale * dy * axes[1][k]);
  };
  const fit = (list) => {
    if (!list.length) return;
    const box = bounds(list);
    eye.at = box.map(([a, b]) => (a + b) / 2);
    eye.distance = Math.max(Math.hypot(...box.map(([a, b]) => b - a)), 2) * 1.5;
    turn();
    for (let k = 0; k < 6; k++) {
      const seen = bounds(list.map((p) => [...screen(view(p)), 0]));
      const [[x0, x1], [y0, y1]] = seen;
      move(width / 2 - (x0 + x1) / 2, height / 2 - (y0 + y1) / 2);
      eye.distance *= Math.min(1.5, Math.max(0.6, Math.max((x1 - x0) / (0.76 * width), (y1 - y0) / (0.72 * height))));
    }
  };
  const colours = () => {
    const style = getComputedStyle(document.documentElement);
    const read = (name) => style.getPropertyValue(name).trim();
    tint = { ink: read("--ink"), soft: read("--soft"), grid: read("--faint"), camera: read("--camera"), sheet: read("--sheet") };
    tint.targets = [...Array(8).keys()].map((i) => read(`--t${i}`));
  };
  const turn = () => {
    const [cy, sy, cp, sp] = [Math.cos(eye.yaw), Math.sin(eye.yaw), Math.cos(eye.pitch), Math.sin(eye.pitch)];
    axes = [[cy, sy, 0], [-sy * sp, cy * sp, cp], [sy * cp, -cy * cp, sp]];
  };
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const focal = () => 1.1 * Math.min(height * 1.25, width);
  const view = (p) => {
    const d = [p[0] - eye.at[0], p[1] - eye.at[1], p[2] - eye.at[2]];
    return [dot(axes[0], d), dot(axes[1], d), eye.distance - dot(axes[2], d)];
  };
  const near = () => eye.distance * 0.02;
  const screen = (v) => [width / 2 + (focal() * v[0]) / v[2], height / 2 - (focal() * v[1]) / v[2]];

  // The part of the segment a-b (view axes) in front of the eye, drawn.
  const stroke = (a, b) => {
    const n = near();
    if (a[2] < n && b[2] < n) return;
    const cut = (p, q) => { const s = (n - p[2]) / (q[2] - p[2]); return [p[0] + s * (q[0] - p[0]), p[1] + s * (q[1] - p[1]), n]; };
    pen.moveTo(...screen(a[2] < n ? cut(a, b) : a));
    pen.lineTo(...screen(b[2] < n ? cut(b, a) : b));
  };
  const lines = (pairs, colour, thick, alpha = 1, dash = []) => {
    pen.beginPath();
    for (const [a, b] of pairs) stroke(view(a), view(b));
    Object.assign(pen, { strokeStyle: colour, lineWidth: thick, globalAlpha: alpha, lineJoin: "round", lineCap: "round" });
    pen.setLineDash(dash);
    pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  };
  const chain = (list) => list.slice(1).map((p, i) => [list[i], p]);
  const label = (p, words, colour, dx = 8) => {
    const v = view(p);
    if (v[2] < near()) return;
    const [x, y] = screen(v);
    Object.assign(pen, { font: "600 13px system-ui, sans-serif", lineWidth: 4, strokeStyle: tint.sheet, fillStyle: colour, lineJoin: "round" });
    const long = pen.measureText(words).width, left = x + dx + long > width - 4 ? x - dx - long : x + dx;
    pen.strokeText(words, left, y - 6);
    pen.fillText(words, left, y - 6);
  };
  const disc = (p, colour, radius, hollow = false) => {
    const v = view(p);
    if (v[2] < near()) return;
    pen.beginPath();
    pen.arc(...screen(v), radius, 0, 7);
    Object.assign(pen, { fillStyle: hollow ? tint.sheet : colour, strokeStyle: hollow ? colour : tint.sheet, lineWidth: 2 });
    pen.fill();
    pen.stroke();
  };

  const grid = () => {
    const box = bounds(points.all.length ? points.all : [[-1, -1, 0], [1, 1, 0]]);
    const span = Math.max(box[0][1] - box[0][0], box[1][1] - box[1][0], 1);
    const raw = span / 10, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw);
    const low = box.map(([a]) => Math.floor(a / step - 0.5) * step), high = box.map(([, b]) => Math.ceil(b / step + 0.5) * step);
    const pairs = [];
    for (let e = low[0]; e <= high[0] + step / 2; e += step) pairs.push([[e, low[1], ground], [e, high[1], ground]]);
    for (let n = low[1]; n <= high[1] + step / 2; n += step) pairs.push([[low[0], n, ground], [high[0], n, ground]]);
    lines(pairs.flatMap(pieces), tint.grid, 1);
    label([(low[0] + high[0]) / 2, high[1], ground], "N", tint.soft, -4);
    label([high[0], (low[1] + high[1]) / 2, ground], "E", tint.soft, -4);
    return step;
  };
  const pieces = ([a, b]) => [0, 1, 2, 3].map((k) => [k, k + 1].map((j) => a.map((v, i) => v + ((b[i] - v) * j) / 4)));

  const ring = (p, c, sigmas) => {
    const v = view(p);
    if (v[2] < near()) return;
    const f = focal() / v[2], s = sigmas * flight.enlarge;
    const rows = [0, 1].map((k) => axes[k].map((a, i) => f * (a + (v[k] / v[2]) * axes[2][i])));
    const full = [[c[0], c[1], c[2]], [c[1], c[3], c[4]], [c[2], c[4], c[5]]];
    const form = (a, b) => dot(a, full.map((r) => dot(r, b)));
    const [xx, xy, yy] = [form(rows[0], rows[0]), form(rows[0], rows[1]), form(rows[1], rows[1])];
    const mid = (xx + yy) / 2, off = Math.hypot((xx - yy) / 2, xy);
    const [x, y] = screen(v), angle = -0.5 * Math.atan2(2 * xy, xx - yy);
    const major = s * Math.sqrt(mid + off), minor = s * Math.sqrt(Math.max(mid - off, 0));
    pen.moveTo(x + major * Math.cos(angle), y + major * Math.sin(angle));
    pen.ellipse(x, y, major, minor, angle, 0, 2 * Math.PI);
  };
  const tube = (target, colour) => {
    for (const [sigmas, alpha] of [[2, 0.1], [1, 0.2]]) {
      pen.beginPath();
      target.rings.forEach((i, k) => target.c[k] && ring(target.p[i], target.c[k], sigmas));
      Object.assign(pen, { fillStyle: colour, globalAlpha: alpha });
      pen.fill("nonzero");
    }
    pen.globalAlpha = 1;
  };
  const along = (t, time) => {
    if (!t.length || time < t[0] || time > t[t.length - 1]) return null;
    let a = 0, b = t.length - 1;
    while (b - a > 1) { const m = (a + b) >> 1; if (t[m] <= time) a = m; else b = m; }
    return [a, b, b > a && t[b] > t[a] ? (time - t[a]) / (t[b] - t[a]) : 0];
  };
  const placeOf = (thing, time) => {
    const at = along(thing.t, time);
    return at && thing.p[at[0]].map((v, k) => v + at[2] * (thing.p[at[1]][k] - v));
  };
  const rotate = ([w, x, y, z], v) => {
    const c = [y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]];
    const d = [y * c[2] - z * c[1], z * c[0] - x * c[2], x * c[1] - y * c[0]];
    return v.map((a, i) => a + 2 * (w * c[i] + d[i]));
  };
  const frustum = (camera, index, place, alpha) => {
    const size = eye.distance * 0.07, [a, b] = camera.half;
    const corners = [[-a, -b, 1], [a, -b, 1], [a, b, 1], [-a, b, 1]].map((v) => {
      const d = rotate(camera.q[index], v.map((k) => k * size));
      return place.map((p, k) => p + d[k]);
    });
    const edges = corners.flatMap((p, i) => [[place, p], [p, corners[(i + 1) % 4]]]);
    lines(edges, tint.camera, 1.3, alpha);
  };

  const drawCamera = (camera) => {
    if (!camera.p.length) return;
    lines(chain(camera.p), tint.camera, 2);
    const count = camera.p.length, last = camera.p[count - 1];
    const moves = Math.hypot(...last.map((v, k) => v - camera.p[0][k])) > 0.05;
    for (const i of moves ? [0, count - 1] : []) frustum(camera, i, camera.p[i], 0.35);
    const at = along(camera.t, Math.min(Math.max(now, camera.t[0]), camera.t[count - 1])) || [0, 0, 0];
    const place = placeOf(camera, now) || camera.p[at[0]];
    frustum(camera, at[0], place, 1);
    lines([[place, [place[0], place[1], ground]]], tint.camera, 1, 0.5, [2, 4]);
    if (show.sights) {
      for (const target of flight.targets) {
        const seen = (camera.seen[target.name] || []).some(([a, b]) => a <= now && now <= b);
        const there = seen && placeOf(target, now);
        if (there) lines([[place, there]], tint.targets[target.colour], 1.1, 0.6);
      }
    }
    disc(place, tint.camera, 4);
    label(place, camera.name, tint.camera);
  };
  const drawTarget = (target) => {
    if (!target.p.length) return;
    const colour = tint.targets[target.colour], guess = new Set(target.guess);
    const sure = [], guessed = [];
    chain(target.p).forEach((pair, i) => (guess.has(i) || guess.has(i + 1) ? guessed : sure).push(pair));
    lines(chain(target.p).map((pair) => pair.map(([e, n]) => [e, n, ground])), tint.soft, 1.5, 0.25);
    if (show.uncertainty) tube(target, colour);
    if (show.truth && target.truth.length) lines(chain(target.truth), tint.ink, 1.2, 0.9, [5, 4]);
    const long = flight.time[1] - flight.time[0] > 90;
    lines(sure, colour, long ? 1.4 : 2.2, long ? 0.45 : 1);
    if (long) lines(chain(target.p.filter((_, i) => target.t[i] <= now && target.t[i] >= now - 20)), colour, 3);
    lines(guessed, colour, 1.3, 0.7, [1, 4]);
    disc(target.p[0], colour, 4, true);
    const place = placeOf(target, now);
    if (place) disc(place, colour, 6);
    label(place || target.p[target.p.length - 1], target.name, colour);
  };

  let step = 1;
  const draw = () => {
    const ratio = window.devicePixelRatio || 1;
    width = canvas.clientWidth || 800;
    height = canvas.clientHeight || 450;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    turn();
    step = grid();
    flight.cameras.forEach(drawCamera);
    flight.targets.forEach(drawTarget);
  };
  let waiting = false;
  const redraw = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
  };

  const views = {
    all: () => { Object.assign(eye, { yaw: -0.6, pitch: 0.55 }); fit(points.all); },
    targets: () => { Object.assign(eye, { yaw: -0.6, pitch: 0.7 }); fit(points.targets); },
    top: () => Object.assign(eye, { yaw: 0, pitch: Math.PI / 2 }),
    side: () => Object.assign(eye, { yaw: 0, pitch: 0.04 }),
  };
  const spin = (dx, dy) => {
    eye.yaw -= dx * 0.008;
    eye.pitch = Math.min(Math.PI / 2, Math.max(-0.3, eye.pitch + dy * 0.008));
  };
  const zoom = (factor) => { eye.distance = Math.min(1e7, Math.max(0.5, eye.distance * factor)); };

  const fingers = new Map();
  canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, [e.clientX, e.clientY]); });
  for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (e) => fingers.delete(e.pointerId));
  canvas.addEventListener("pointermove", (e) => {
    const from = fingers.get(e.pointerId);
    if (!from) return;
    const to = [e.clientX, e.clientY], [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    if (fingers.size > 1) {
      const other = [...fingers].find(([id]) => id !== e.pointerId)[1];
      const gap = (p) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 10);
      zoom(gap(from) / gap(to));
      spin(dx / 2, dy / 2);
    } else if (e.shiftKey || e.buttons & 4) move(dx, dy);
    else spin(dx, dy);
    fingers.set(e.pointerId, to);
    redraw();
  });
  canvas.addEventListener("wheel", (e) => {
    if (document.activeElement !== canvas) return;
    e.preventDefault();
    zoom(Math.exp(e.deltaY * 0.0012));
    redraw();
  }, { passive: false });
  const keys = {
    ArrowLeft: () => spin(12, 0), ArrowRight: () => spin(-12, 0), ArrowUp: () => spin(0, 10), ArrowDown: () => spin(0, -10),
    "+": () => zoom(0.85), "=": () => zoom(0.85), "-": () => zoom(1.18), "0": views.all,
  };
  canvas.addEventListener("keydown", (e) => {
    if (!keys[e.key] || e.ctrlKey || e.metaKey || e.altKey) return;
    e.preventDefault();
    keys[e.key]();
    redraw();
  });

  new ResizeObserver(redraw).observe(canvas);
  const scheme = () => { colours(); draw(); };
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", scheme);
  window.matchMedia("print").addEventListener("change", scheme);
  width = canvas.clientWidth || 800;
  height = canvas.clientHeight || 450;
  colours();
  views.all();
  draw();
  return {
    words: () => (flight.time[1] - flight.time[0] > 90 ? "The last 20 s are bold. " : "") + `Grid of ${step} m` + (flight.enlarge > 1 ? `; uncertainty (1\u03c3, 2\u03c3) drawn ${flight.enlarge} \u00d7 larger.` : "; uncertainty (1\u03c3, 2\u03c3) at true size."),
    setTime: (time) => { now = time; redraw(); },
    setView: (name) => { views[name](); redraw(); },
    setShown: (name, on) => { show[name] = on; redraw(); },
    placeOf,
  };
};
