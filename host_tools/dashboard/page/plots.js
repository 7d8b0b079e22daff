// The plots: one time axis for all, cursor with values, zoom, hold.

import { $, clock, colour, element, figures } from "./parts.js";

const STEPS_S = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400];
const DASHES = { solid: [], dashed: [7, 4], dotted: [2, 3] };

// label: [column, legend, colour of the theme, dash, what else]
const line = (column, label, ink, dash = "solid", more = {}) => ({ column, label, ink, dash, ...more });
const three = (sigma, ink) => [
  { column: sigma, label: "", ink, dash: "dotted", factor: 3, band: 1 },
  { column: sigma, label: "", ink, dash: "dotted", factor: -3, band: -1 },
];

export const PLOTS = [
  {
    id: "position", title: "Position error", unit: "m", empty: "The truth is not known: name the scenario",
    lines: [line("error_east_m", "east", "east"), line("error_north_m", "north", "north", "dashed"),
      ...three("sigma_east_m", "east"), ...three("sigma_north_m", "north"),
      line("horizontal_protection_m", "protection level", "third", "dashed", { step: true })], sigma: "dotted: ±3σ",
  },
  {
    id: "velocity", title: "Velocity error", unit: "m/s", empty: "The truth is not known: name the scenario",
    lines: [line("error_east_mps", "east", "east"), line("error_north_mps", "north", "north", "dashed"),
      ...three("sigma_east_mps", "east"), ...three("sigma_north_mps", "north")], sigma: "dotted: ±3σ",
  },
  {
    id: "angles", title: "Table angles", unit: "°", empty: "No axis has been heard yet",
    lines: [line("inner_deg", "inner", "east"), line("outer_deg", "outer", "north", "dashed"),
      line("inner_goal_deg", "", "east", "dotted", { step: true, thin: true }),
      line("outer_goal_deg", "", "north", "dotted", { step: true, thin: true })], note: "dotted: position of the scheme",
  },
  {
    id: "parity", title: "Parity / threshold", unit: "", note: "→ the sensor it points at, window", empty: "The firmware compares no sensors", least: [0, 1.25], threshold: 1,
    lines: [line("gyro_parity", "gyros", "east", "solid", { step: true, points: ["G", "gyro_suspect", "gyro_window_log2"] }),
      line("accelerometer_parity", "accelerometers", "north", "dashed", { step: true, points: ["A", "accelerometer_suspect", "accelerometer_window_log2"] })],
  },
  {
    id: "load", title: "Load", unit: "%", empty: "", least: [0, 10],
    lines: [line("bus_load_percent", "bus", "east"), line("firmware_load_percent", "firmware", "north", "dashed"),
      line("lateness_ms", "lateness / ms", "third", "dotted", { scale: "ms" })],
  },
];

export const SPANS = [["1 min", 60], ["10 min", 600], ["whole run", Infinity]];

// 0:50, 1:40, 1:02:30, 1:02:30.5
function minutes(seconds, decimals = 0) {
  const rounded = Number(seconds.toFixed(decimals));
  const [h, m] = [Math.floor(rounded / 3600), Math.floor((rounded % 3600) / 60)];
  const s = (rounded % 60).toFixed(decimals).padStart(decimals ? 3 + decimals : 2, "0");
  return h ? `${h}:${String(m).padStart(2, "0")}:${s}` : `${m}:${s}`;
}

function range(least) {
  return (u, low, high) => {
    if (low == null || high == null) return least ?? [-1, 1];
    let [a, b] = [low, high];
    if (least) [a, b] = [Math.min(a, least[0]), Math.max(b, least[1])];
    const margin = (b - a) * 0.06 || Math.abs(a) * 0.1 || 0.001;
    return [least && a === least[0] ? a : a - margin, b + margin];
  };
}

// Plots share the cursor, and the band that is dragged; only the plot where it ends zooms all.
const isOfCursor = (type) => type === "mousemove" || type === "mouseleave";

// Points further outside than the view is wide move to its edge: along a line out to them, a dash would
// be drawn a hundred thousand times.
export function farEnds(times, low, high) {
  const last = times.length - 1;
  const ends = [];
  if (last > 0 && times[0] < 2 * low - high) ends.push({ at: 0, next: 1, time: low });
  if (last > 0 && times[last] > 2 * high - low) ends.push({ at: last, next: last - 1, time: high });
  return ends.map((end) => ({ ...end, share: (end.time - times[end.at]) / (times[end.next] - times[end.at]) }));
}

class Plot {
  constructor(spec, board) {
    this.spec = spec;
    this.board = board;
    this.legend = element("span", { class: "legend" });
    this.area = element("div", { class: "area" });
    this.empty = element("div", { class: "empty", hidden: true }, spec.empty);
    const unit = spec.unit ? ` / ${spec.unit.includes("/") ? `(${spec.unit})` : spec.unit}` : "";
    this.note = element("small");
    this.root = element("div", { class: "plot", id: `plot-${spec.id}` },
      element("h3", {}, element("span", {}, spec.title, element("small", {}, unit)), this.note, this.legend), this.area, this.empty);
    $("plots").append(this.root);
    this.build();
  }

  build() {
    this.chart?.destroy();
    this.legend.replaceChildren();
    this.values = [];
    const spec = this.spec;
    const series = [{}];
    const bands = [];
    spec.lines.forEach((one, k) => {
      const ink = colour(one.ink);
      series.push({
        scale: one.scale ?? "y", stroke: ink, width: one.band || one.thin ? 1 : 1.6, dash: DASHES[one.dash],
        points: { show: false }, spanGaps: false,
        paths: one.step ? uPlot.paths.stepped({ align: 1 }) : undefined,
      });
      if (one.band === 1) bands.push({ series: [k + 1, k + 2], fill: colour(`band-${one.ink}`) });
      if (one.label) this.addLegend(one, ink);
      else this.values.push(null);
    });
    const hasMs = (u) => Boolean(u.data?.[spec.lines.length]?.some((v) => v != null));
    const axis = { stroke: colour("soft"), font: "11px system-ui, sans-serif", ticks: { stroke: colour("grid"), size: 4 }, grid: { stroke: colour("grid"), width: 1 } };
    const axes = [
      { ...axis, size: 22, incrs: STEPS_S, values: (u, splits) => splits.map((s) => (splits.at(-1) < 100 ? clock(s, splits[1] - splits[0] < 1 ? 1 : 0) : minutes(s, splits[1] - splits[0] < 1 ? 1 : 0))) },
      { ...axis, size: 56, gap: 3, space: 24, values: (u, splits) => splits.map((s) => figures(s, 3).replace(/\.?0+$/, (z, at, text) => (text.includes(".") && !text.includes("e") ? "" : z))) },
    ];
    if (spec.lines.some((one) => one.scale === "ms"))
      axes.push({ ...axis, scale: "ms", side: 1, size: (u) => (hasMs(u) ? 44 : 0), grid: { show: false }, values: (u, splits) => splits.map((s) => (hasMs(u) ? `${s} ms` : "")) });
    const options = {
      width: 300, height: 100, series, axes, bands, legend: { show: false }, padding: [6, 16, 0, 0],
      scales: { x: { time: false, auto: false }, y: { range: range(spec.least) }, ms: { range: range([0, 5]) } },
      cursor: { sync: { key: "time", filters: { pub: isOfCursor } }, drag: { x: true, y: false, setScale: false }, points: { size: 6 }, y: false },
      hooks: {
        setSelect: [(u) => {
          if (u.select.width > 4) this.board.zoom(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
          this.board.clearSelections();
        }],
        setCursor: [(u) => this.showValues(u.cursor.idx)],
        draw: [(u) => this.drawExtras(u)],
      },
    };
    this.chart = new uPlot(options, [[0], ...spec.lines.map(() => [null])], this.area);
    this.area.ondblclick = () => this.board.zoom(null, null);
    this.resize();
  }

  addLegend(one, ink) {
    const mark = element("i");
    mark.style.borderTopColor = ink;
    mark.style.borderTopStyle = one.dash;
    const value = element("b", {}, "–");
    this.legend.append(element("span", {}, mark, `${one.label} `, value));
    this.values.push(value);
  }

  resize() {
    const { clientWidth, clientHeight } = this.area;
    if (clientWidth > 20 && clientHeight > 20) this.chart.setSize({ width: clientWidth, height: clientHeight });
  }

  drawExtras(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.lineWidth = devicePixelRatio;
    if (this.spec.threshold != null) {
      const y = u.valToPos(this.spec.threshold, "y", true);
      ctx.strokeStyle = colour("excluded");
      ctx.setLineDash([10, 4]);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      ctx.fillStyle = colour("excluded");
      ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
      ctx.textAlign = "left";
      ctx.fillText("threshold", bbox.left + 6 * devicePixelRatio, y - 4 * devicePixelRatio);
    }
    const now = this.board.playedTo;
    if (now != null) {
      const x = u.valToPos(now, "x", true);
      if (x >= bbox.left && x <= bbox.left + bbox.width) {
        ctx.strokeStyle = colour("text");
        ctx.setLineDash([]);
        ctx.beginPath();
        ctx.moveTo(x, bbox.top);
        ctx.lineTo(x, bbox.top + bbox.height);
        ctx.stroke();
      }
    }
    ctx.restore();
  }

  draw(low, high) {
    const { store } = this.board;
    const from = Math.max(0, store.at(low) - 1);
    const to = Math.min(store.times.length, store.at(high) + 1);
    const times = store.times.slice(from, to);
    const ends = farEnds(times, low, high);
    let isEmpty = true;
    let hasSigma = false;
    const data = [times];
    for (const one of this.spec.lines) {
      let column = store.column(one.column).slice(from, to);
      if (one.factor) column = column.map((v) => (v == null ? null : v * one.factor));
      for (const { at, next, share } of ends) {
        const [from, to] = [column[at], column[next]];
        if (one.step) column[at] = at ? to : from;
        else if (from != null && to != null) column[at] = from + (to - from) * share;
      }
      const has = column.some((v) => v != null);
      if (one.band) hasSigma ||= has;
      else if (has) isEmpty = false;
      data.push(column);
    }
    for (const { at, time } of ends) times[at] = time;
    this.empty.hidden = !isEmpty || !this.spec.empty;
    this.note.textContent = this.spec.note ?? (hasSigma ? this.spec.sigma ?? "" : "");
    this.chart.batch(() => {
      this.chart.setData(data, false);
      this.chart.setScale("x", { min: low, max: high });
    });
    this.showValues(this.chart.cursor.left >= 0 ? this.chart.cursor.idx : null);
  }

  // The sensor at which a parity points the most, and its window: → G3, 64 s.
  pointed({ points }, time) {
    if (!points || time == null) return "";
    const { store } = this.board;
    const [sensor, power] = points.slice(1).map((name) => store.column(name)[store.at(time)]);
    return sensor ? ` → ${points[0]}${sensor}, ${2 ** power} s` : "";
  }

  // Values at the cursor, or the latest.
  showValues(place) {
    const data = this.chart.data;
    this.values.forEach((node, k) => {
      if (!node) return;
      const column = data[k + 1];
      let at = place ?? column.length - 1;
      if (place == null && this.board.playedTo != null) at = Math.min(at, this.board.store.at(this.board.playedTo) - this.board.store.at(data[0][0]));
      node.textContent = figures(column[at]) + this.pointed(this.spec.lines[k], data[0][at]);
    });
  }
}

export class Plots {
  constructor(store) {
    this.store = store;
    this.span = 60;
    this.zoomed = null;
    this.isHeld = false;
    this.playedTo = null; // of a recording
    this.plots = PLOTS.map((spec) => new Plot(spec, this));
    new ResizeObserver(() => { this.plots.forEach((plot) => plot.resize()); this.draw(); }).observe($("plots"));
    for (const [words, seconds] of SPANS)
      $("spans").append(element("button", { onclick: () => this.setSpan(seconds), "data-span": seconds }, words));
    $("hold").onclick = () => this.hold();
    this.setSpan(60);
  }

  setSpan(seconds) {
    this.span = seconds;
    this.zoomed = null;
    for (const button of $("spans").children) button.setAttribute("aria-pressed", Number(button.dataset.span) === seconds);
    if (this.isHeld) this.hold();
    this.draw();
  }

  hold() {
    this.isHeld = !this.isHeld;
    if (this.isHeld) this.held = this.zoomed ?? this.window();
    $("hold").setAttribute("aria-pressed", this.isHeld);
    this.draw();
  }

  zoom(low, high) {
    this.zoomed = low == null ? null : [low, high];
    if (this.isHeld && low != null) this.held = this.zoomed;
    if (this.isHeld && low == null) { this.isHeld = false; $("hold").setAttribute("aria-pressed", false); }
    this.draw();
  }

  // The band that is dragged shows in all plots.
  clearSelections() {
    for (const plot of this.plots) plot.chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }

  window() {
    const { first, last } = this.store;
    if (this.span === Infinity) return [first, Math.max(last, first + 1)];
    const end = this.playedTo == null ? last : Math.min(last, Math.max(this.playedTo + this.span * 0.25, first + this.span));
    return [Math.max(end - this.span, 0), Math.max(end, this.span)];
  }

  draw() {
    const [low, high] = this.isHeld ? this.held : this.zoomed ?? this.window();
    for (const plot of this.plots) plot.draw(low, high);
  }

  restyle() {
    for (const plot of this.plots) plot.build();
    this.draw();
  }
}
