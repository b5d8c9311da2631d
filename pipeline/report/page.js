"use strict";
// One moment of common time for the whole page: slider, 3D view, maps and every chart over time follow it.
(() => {
  const byId = (name) => document.getElementById(name);
  const data = byId("flight");
  if (data) {
    const flight = JSON.parse(data.textContent);
    const space = makeSpace(byId("space"), flight);
    const slider = byId("moment"), words = byId("moment-words"), play = byId("play");
    const [start, end] = flight.time;
    const charts = [...document.querySelectorAll("svg[data-t0]")];
    const maps = [...document.querySelectorAll("svg.map")];
    const things = new Map([...flight.cameras, ...flight.targets].map((t) => [t.name, t]));

    const onCharts = (time) => {
      for (const chart of charts) {
        const { t0, t1, x0, x1 } = chart.dataset, share = (time - t0) / (t1 - t0);
        const x = share >= 0 && share <= 1 ? +x0 + share * (x1 - x0) : -9;
        const line = chart.querySelector(".moment");
        line.setAttribute("x1", x);
        line.setAttribute("x2", x);
      }
    };
    const onMaps = (time) => {
      for (const map of maps) {
        const { west, north, scale } = map.dataset;
        for (const mark of map.querySelectorAll(".now")) {
          const place = space.placeOf(things.get(mark.dataset.name), time) || [-1e6, 1e6];
          mark.setAttribute("cx", ((place[0] - west) * scale).toFixed(1));
          mark.setAttribute("cy", ((north - place[1]) * scale).toFixed(1));
        }
      }
    };
    const films = JSON.parse((byId("films") || { textContent: "[]" }).textContent);
    const onFilms = (time) => {
      for (const film of films) {
        const box = document.querySelector(`.film[data-camera="${CSS.escape(film.camera)}"]`), { t } = film;
        let k = 0;
        while (k + 1 < t.length && Math.abs(t[k + 1] - time) <= Math.abs(t[k] - time)) k++;
        const gap = t.length > 1 ? (t[t.length - 1] - t[0]) / (t.length - 1) : 1;
        box.classList.toggle("away", time < t[0] - gap || time > t[t.length - 1] + gap);
        if (film.shown === k) continue;
        film.shown = k;
        box.querySelector("img").src = `data:image/jpeg;base64,${film.src[k]}`;
        box.querySelector(".when").textContent = `frame ${film.frame[k]}, ${t[k].toFixed(2)} s`;
        const svg = box.querySelector("svg"), make = (kind, of) => {
          const node = document.createElementNS(svg.namespaceURI, kind);
          for (const [key, value] of Object.entries(of)) node.setAttribute(key, value);
          return svg.appendChild(node);
        };
        svg.replaceChildren();
        for (const [name, colour, cx, cy] of film.marks[k]) {
          make("circle", { cx, cy, r: 9, class: "under" });
          make("circle", { cx, cy, r: 9, class: colour < 0 ? "c-ink" : `c${colour}` });
          const right = cx > svg.viewBox.baseVal.width - 70;
          make("text", { x: right ? cx - 13 : cx + 13, y: cy + 4, "text-anchor": right ? "end" : "start", class: colour < 0 ? "c-ink" : `c${colour}` }).textContent = name;
        }
      }
    };
    const setTime = (time, live = true) => {
      if (live) document.body.classList.add("live");
      const held = Math.min(end, Math.max(start, time));
      slider.value = held;
      words.textContent = `${held.toFixed(2)} s`;
      space.setTime(held);
      onCharts(held);
      onMaps(held);
      onFilms(held);
    };

    slider.addEventListener("input", () => setTime(+slider.value));
    for (const chart of charts) {
      chart.addEventListener("pointermove", (e) => {
        const box = chart.getBoundingClientRect(), { t0, t1, x0, x1 } = chart.dataset;
        const x = ((e.clientX - box.left) / box.width) * chart.viewBox.baseVal.width;
        if (x >= +x0 && x <= +x1) setTime(+t0 + ((x - x0) / (x1 - x0)) * (t1 - t0));
      });
    }
    for (const button of document.querySelectorAll("[data-moment]")) button.addEventListener("click", () => setTime(+button.dataset.moment));
    let playing = 0;
    play.addEventListener("click", () => {
      const stop = () => { cancelAnimationFrame(playing); playing = 0; play.textContent = "\u25b6"; play.setAttribute("aria-label", "Play"); };
      if (playing) return stop();
      const pace = Math.max(1, (end - start) / 30), from = +slider.value < end - 0.01 * (end - start) ? +slider.value : start;
      let began = null;
      const tick = (stamp) => {
        began = began === null ? stamp : began;
        const time = from + (pace * (stamp - began)) / 1000;
        setTime(time);
        if (time >= end) stop(); else playing = requestAnimationFrame(tick);
      };
      play.textContent = "\u275a\u275a";
      play.setAttribute("aria-label", "Pause");
      playing = requestAnimationFrame(tick);
    });
    for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => space.setView(button.dataset.view));
    for (const box of document.querySelectorAll("[data-show]")) box.addEventListener("change", () => space.setShown(box.dataset.show, box.checked));
    byId("space-words").textContent = space.words();
    setTime(start + 0.4 * (end - start), false);
  }
  const ground = byId("ground");
  if (ground) ground.addEventListener("change", () => document.body.classList.toggle("bare", !ground.checked));
  window.addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
  document.documentElement.setAttribute("data-ready", "true");
})();
