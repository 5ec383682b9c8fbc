"use strict";
(() => {
  const style = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  const make = (tag, name, parent) => Object.assign(parent.appendChild(document.createElement(tag)), { className: name });
  const minus = text => text.replace("-", "−");
  const number = (v, digits = 4) => {
    if (v === 0 || !isFinite(v)) return String(v);
    const power = Math.floor(Math.log10(Math.abs(v)));
    if (power >= -3 && power < 5) return minus(String(+v.toPrecision(digits)));
    const raised = String(power).replace(/./g, c => c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]);
    return minus(String(+(v / 10 ** power).toPrecision(digits))) + "·10" + raised;
  };

  // Charts: uPlot in place of each still drawing, one plot a panel, with one axis of time for all.
  let charts = 0;
  class Chart {
    constructor(host, data) {
      Object.assign(this, { host, data, key: "chart" + charts++, plots: [], values: [] });
      this.tile = host.closest(".tile");
      this.hosts = data.panels.map(panel => {
        const box = make("div", "panel", host);
        box.setAttribute("aria-hidden", "true");
        const label = make("span", "label", box);
        label.innerHTML = panel.axis;
        this.values.push(make("span", "readout", label));
        return box;
      });
      this.bar = make("div", "bar", host);
      for (const [words, act] of [["+", () => this.zoom(0.5)], ["−", () => this.zoom(2)], ["◀", () => this.shift(-0.25)],
        ["▶", () => this.shift(0.25)], ["whole", () => this.whole()]]) {
        const button = make("button", "", this.bar);
        button.type = "button";
        button.append(words);
        button.setAttribute("aria-label", { "+": "Zoom in", "−": "Zoom out", "◀": "Earlier", "▶": "Later" }[words] || "Show the whole");
        button.onclick = act;
      }
      const seen = new Set();
      for (const curve of data.panels.flatMap(p => p.curves)) {
        if (seen.has(curve.label)) continue;
        seen.add(curve.label);
        const entry = make("span", "legend", this.bar);
        entry.append(make("i", curve.role, entry), curve.label);
      }
      make("span", "axis", this.bar).textContent = "across: " + data.axis;
      this.readout = make("span", "readout", this.bar);
      this.tables = data.panels.map(panel => uPlot.join(panel.curves.map(c => c.h.length
        ? [c.t, c.v, c.v.map((v, k) => v === null || c.h[k] === null ? null : v - c.h[k]), c.v.map((v, k) => v === null || c.h[k] === null ? null : v + c.h[k])]
        : [c.t, c.v])));
      host.classList.add("live");
      host.setAttribute("role", "group");
      host.setAttribute("aria-label", host.querySelector("svg").getAttribute("aria-label"));
      new ResizeObserver(() => this.draw()).observe(host);
      this.draw();
    }
    get isSmall() { return this.tile && !this.tile.classList.contains("full") && this.host.clientWidth < 260; }
    size() {
      const rows = this.hosts.length, last = this.isSmall ? 0 : 18;
      const height = this.tile ? (this.host.clientHeight - this.bar.offsetHeight - last) / rows : 170;
      return { width: this.host.clientWidth, height: Math.max(30, Math.floor(height)) };
    }
    draw(again) {
      const { width, height } = this.size();
      if (!width || (!again && this.drawn === width + "x" + height)) return;
      this.drawn = width + "x" + height;
      const view = this.plots[0] && this.range;
      this.plots.forEach(plot => plot.destroy());
      this.plots = this.hosts.map((host, k) => this.plot(host, k, width, height));
      if (view) this.plots.forEach(plot => plot.setScale("x", view));
    }
    plot(host, k, width, height) {
      const panel = this.data.panels[k], isLast = k + 1 === this.hosts.length, small = this.isSmall, series = [{}], bands = [];
      for (const curve of panel.curves) {
        const color = style("--" + curve.role), dots = curve.role === "measured";
        series.push({ label: curve.label, stroke: color, width: dots ? 0 : curve.role === "model" ? 1.2 : 2,
          dash: curve.role === "truth" ? [7, 5] : undefined, paths: dots ? () => null : undefined,
          points: { show: dots, size: small ? 2 : 4, fill: color, width: 0 } });
        if (curve.h.length) {
          const at = series.length;
          for (let n = 0; n < 2; n++) series.push({ stroke: "transparent", width: 0, points: { show: false } });
          bands.push({ series: [at + 1, at], fill: style("--band") });
        }
      }
      const ink = style("--soft"), grid = { stroke: style("--grid"), width: 1 };
      const axis = { stroke: ink, grid, ticks: { ...grid, size: 4 }, font: "12px system-ui, sans-serif" };
      const own = isLast && !small ? 18 : 0;
      const plot = new uPlot({
        width, height: height + own, padding: [4, 8, 0, small ? 2 : 0], legend: { show: false }, series, bands,
        scales: { x: { time: false } },
        axes: [{ ...axis, size: isLast && !small ? 26 : 8, values: (u, at) => at.map(v => isLast && !small ? number(v) : "") },
          { ...axis, size: small ? 2 : 74, space: 18, values: (u, at) => at.map(v => small ? "" : number(v, 6)) }],
        cursor: { show: !small, sync: { key: this.key }, drag: { x: true, y: false }, points: { size: 7 } },
        hooks: { setCursor: [u => this.read(u, k)], setScale: [(u, name) => { if (name === "x") this.range = { ...u.scales.x }; }] },
      }, this.tables[k], host);
      plot.over.addEventListener("pointermove", e => {
        if (e.pointerType === "touch") this.plots.forEach(p => p.setCursor({ left: e.offsetX, top: 10 }));
      });
      return plot;
    }
    read(u, k) {
      const at = u.cursor.idx;
      if (at == null) return;
      const t = this.at = u.data[0][at];
      // Of each curve the nearest value, as curves have times of their own.
      const near = c => {
        const after = c.t.findIndex(v => v >= t), end = after < 0 ? c.t.length - 1 : after;
        const n = end > 0 && t - c.t[end - 1] < c.t[end] - t ? end - 1 : end;
        return c.v[n] == null ? "–" : number(c.v[n], 4) + (c.h[n] == null ? "" : " ± " + number(c.h[n], 2));
      };
      this.values[k].textContent = ": " + this.data.panels[k].curves.map(near).join(" | ");
      this.readout.textContent = "at " + number(t);
    }
    zoom(factor) {
      const { min, max } = this.plots[0].scales.x, at = this.at > min && this.at < max ? this.at : (min + max) / 2;
      this.show(at - factor * (at - min), at + factor * (max - at));
    }
    shift(part) {
      const { min, max } = this.plots[0].scales.x, by = part * (max - min);
      this.show(min + by, max + by);
    }
    show(min, max) {
      const [low, high] = this.bounds(), width = Math.min(max - min, high - low);
      const from = Math.min(Math.max(min, low), high - width);
      this.plots.forEach(plot => plot.setScale("x", { min: from, max: from + width }));
    }
    bounds() { return [Math.min(...this.tables.map(t => t[0][0])), Math.max(...this.tables.map(t => t[0].at(-1)))]; }
    whole() { this.show(...this.bounds()); }
  }

  const live = [];
  const draw = root => all(".drawn", root).forEach(host => {
    const script = (host.dataset.of ? document.getElementById(host.dataset.of).parentElement : host).querySelector("script");
    if (!script || host.dataset.done || !host.clientWidth) return;
    host.dataset.done = "1";
    live.push(new Chart(host, JSON.parse(script.textContent)));
  });
  draw(document);
  all("details").forEach(details => details.addEventListener("toggle", () => details.open && draw(details)));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => live.forEach(chart => chart.draw(true)));

  // The path in space turns about the vertical and tips.
  for (const svg of all("svg.space")) {
    const [lx, ly, lz, hx, hy, hz, margin, azimuth, elevation] = svg.dataset.view.split(" ").map(Number);
    const middle = [(lx + hx) / 2, (ly + hy) / 2, (lz + hz) / 2];
    const corners = [lx, hx].flatMap(x => [ly, hy].flatMap(y => [lz, hz].map(z => [x, y, z])));
    const parts = all("[data-p]", svg).map(part => [part, part.dataset.p.split(";").map(line => line.split(" ").map(Number))]);
    let turn = azimuth, tip = elevation;
    const show = () => {
      const [sa, ca, se, ce] = [Math.sin(turn), Math.cos(turn), Math.sin(tip), Math.cos(tip)];
      const [width, height] = [svg.clientWidth || 860, svg.clientHeight || 560];
      svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
      svg.classList.toggle("small", width < 260);
      const turned = (x, y, z) => [x * ca + y * sa, z * ce + (y * ca - x * sa) * se];
      const ends = corners.map(c => turned(...c.map((v, k) => v - middle[k])));
      const reach = k => Math.max(1e-9, ...ends.map(end => Math.abs(end[k])));
      const edge = Math.min(margin, width / 6);
      const scale = Math.min((width / 2 - edge) / reach(0), (height / 2 - edge) / reach(1));
      const pixel = (line, k) => {
        const [x, y] = turned(line[k] - middle[0], line[k + 1] - middle[1], line[k + 2] - middle[2]);
        return [(width / 2 + scale * x).toFixed(1), (height / 2 - scale * y).toFixed(1)];
      };
      for (const [part, lines] of parts) {
        if (part.tagName === "path") {
          part.setAttribute("d", lines.map(line => "M" + Array.from({ length: line.length / 3 }, (_, k) => pixel(line, 3 * k).join(" ")).join("L")).join(""));
        } else {
          const [x, y] = pixel(lines[0], 0);
          for (const name of part.tagName === "circle" ? ["cx", "cy"] : ["x", "y"]) part.setAttribute(name, name.endsWith("x") ? x : y);
        }
      }
    };
    const rotate = (dx, dy) => { turn += dx; tip = Math.min(1.55, Math.max(-0.2, tip + dy)); show(); };
    new ResizeObserver(show).observe(svg);
    svg.addEventListener("pointerdown", e => svg.setPointerCapture(e.pointerId));
    svg.addEventListener("pointermove", e => e.buttons && rotate(-e.movementX * 0.008, e.movementY * 0.008));
    svg.addEventListener("keydown", e => {
      const step = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
      if (step) { rotate(...step); e.preventDefault(); }
    });
  }

  // A tile fills the screen and goes back.
  const enlarge = (tile, on) => {
    const button = tile.querySelector(".enlarge");
    tile.classList.toggle("full", on);
    button.setAttribute("aria-expanded", on);
    button.textContent = on ? "✕" : "⤢";
    document.body.style.overflow = on ? "hidden" : "";
    if (!on) button.focus();
  };
  for (const tile of all(".tile")) {
    tile.querySelector(".enlarge").addEventListener("click", e => { e.stopPropagation(); enlarge(tile, !tile.classList.contains("full")); });
    tile.addEventListener("click", () => innerWidth <= 600 && !tile.classList.contains("full") && enlarge(tile, true));
  }
  addEventListener("keydown", e => e.key === "Escape" && all(".tile.full").forEach(tile => enlarge(tile, false)));

  // A film that was made after the page is loaded when it is asked for.
  for (const button of all("[data-film]")) {
    button.onclick = () => {
      const video = document.createElement("video");
      Object.assign(video, { controls: true, src: button.dataset.film, onloadedmetadata: () => { button.hidden = true; } });
      video.setAttribute("aria-label", "The flight with what was found drawn into it");
      video.onerror = () => { video.remove(); button.nextElementSibling.textContent = "It is not there, or cannot be played."; };
      button.nextElementSibling.textContent = "";
      button.closest("figure").prepend(video);
    };
  }

  // All is printed, also what is folded.
  let closed = [];
  addEventListener("beforeprint", () => (closed = all("details:not([open])")).forEach(d => { d.open = true; }));
  addEventListener("afterprint", () => closed.forEach(d => { d.open = false; }));
})();
