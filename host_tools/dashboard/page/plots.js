// The plots: one time axis for all, cursor with values, zoom, hold, choice.

import { ANGLE_STEPS, CHARTS, labels, lowestOf, rangeOf, turned, wrapped } from "./charts.js";
import { keep, recall } from "./kept.js";
import { $, clock, colour, element, figures, parityWords } from "./parts.js";
import { offer } from "./saving.js";

const STEPS_S = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400];
const DASHES = { solid: [], dashed: [7, 4], dotted: [2, 3] };
const FONT = "11px system-ui, sans-serif";
const LEAST_HIGH = 122; // px, of a plot and the gap below it
const BY_IMPORTANCE = ["position", "parity", "angles", "attitude", "estimator", "velocity", "load"];
const NARROW = 520; // px; the axis is narrower, too

export const SPANS = [["1 min", 60], ["10 min", 600], ["whole run", Infinity]];

function timeLabels(u, splits) {
  const decimals = splits[1] - splits[0] < 1 ? 1 : 0;
  return splits.map((s) => clock(s, decimals));
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

// Gaps where a line is broken, however many points a pixel has; beyond the points, for the line is wide.
function broken(u, series, first, last, found) {
  const [times, values] = [u.data[0], u.data[series]];
  for (let k = Math.max(first, 1); k < last; k++) {
    if (values[k] != null || values[k - 1] == null || values[k + 1] == null) continue;
    const [from, to] = [times[k - 1], times[k + 1]].map((time) => u.valToPos(time, "x", true));
    found.push([from - 2, to + 2]);
  }
  return merged(found);
}

// Spans in order, those that overlap as one: of one within another uPlot would draw the end.
export function merged(spans) {
  const found = [];
  for (const [from, to] of spans.sort((a, b) => a[0] - b[0])) {
    if (found.length && from <= found.at(-1)[1]) found.at(-1)[1] = Math.max(found.at(-1)[1], to);
    else found.push([from, to]);
  }
  return found;
}

class Plot {
  constructor(spec, board) {
    this.spec = spec;
    this.board = board;
    this.legend = element("span", { class: "legend" });
    this.area = element("div", { class: "area" });
    this.empty = element("div", { class: "empty", hidden: true });
    const unit = spec.unit ? ` / ${spec.unit.includes("/") ? `(${spec.unit})` : spec.unit}` : "";
    this.note = element("small", { class: "note" });
    const name = spec.title.toLowerCase();
    this.enlarger = element("button", { class: "icon", title: "enlarge (Esc: back)", "aria-label": `enlarge ${name}`, "aria-pressed": "false", onclick: () => board.enlarge(this) }, "⤢");
    const save = element("button", { class: "icon", title: "save as PNG, SVG or CSV", "aria-label": `save ${name}`, onclick: () => offer(this) }, "↓");
    this.root = element("div", { class: "plot", id: `plot-${spec.id}` },
      element("h3", {}, element("span", { class: "name" }, spec.title, element("small", {}, unit)), this.note, this.legend, element("span", { class: "icons" }, this.enlarger, save)),
      this.area, this.empty);
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
        ...(one.wraps || one.centred ? { gaps: broken } : {}),
      });
      if (one.band === 1) bands.push({ series: [k + 1, k + 2], fill: `color-mix(in srgb, ${ink} ${one.opacity ?? 14}%, transparent)` });
      this.values.push(one.label ? this.addLegend(one, ink) : null);
    });
    const options = {
      width: 300, height: 100, series, axes: this.axes(), bands, legend: { show: false }, padding: [6, 16, 0, 0],
      scales: this.scales(),
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

  scales() {
    const others = this.others().map((scale) => [scale, { range: rangeOf({ least: scale === "ms" ? [0, 5] : undefined, angles: this.spec.angles }) }]);
    return { x: { time: false, auto: false }, y: { range: rangeOf(this.spec) }, ...Object.fromEntries(others) };
  }

  // Scales with an axis of their own, on the right.
  others() {
    return [...new Set(this.spec.lines.map((one) => one.scale).filter(Boolean))];
  }

  axes() {
    const { lines, angles } = this.spec;
    const axis = { stroke: colour("soft"), font: FONT, ticks: { stroke: colour("grid"), size: 4 }, grid: { stroke: colour("grid"), width: 1 } };
    const size = (u) => (u.width < NARROW ? 44 : 56);
    const has = (u, scale) => lines.some((one, k) => one.scale === scale && u.data?.[k + 1]?.some((v) => v != null));
    return [
      { ...axis, size: 22, incrs: STEPS_S, values: timeLabels },
      { ...axis, size, gap: 3, space: 24, ...(angles ? { incrs: ANGLE_STEPS } : {}), values: (u, splits) => labels(splits) },
      ...this.others().map((scale) => ({
        ...axis, scale, side: 1, size: (u) => (has(u, scale) ? 56 : 0), gap: 3, space: 24, grid: { show: false },
        ...(angles ? { incrs: ANGLE_STEPS } : {}),
        values: (u, splits) => (has(u, scale) ? labels(angles ? splits.map((v) => wrapped(v, 0)) : splits).map((text) => `${text}${angles ? "°" : ` ${scale}`}`) : splits.map(() => "")),
      })),
    ];
  }

  addLegend(one, ink) {
    const mark = element("i");
    mark.style.borderTopColor = ink;
    mark.style.borderTopStyle = one.dash;
    const value = element("b", {}, "–");
    this.legend.append(element("span", { hidden: one.optional }, mark, `${one.label} `, value));
    return value;
  }

  resize() {
    const { clientWidth, clientHeight } = this.area;
    if (clientWidth > 20 && clientHeight > 20) this.chart.setSize({ width: clientWidth, height: clientHeight });
  }

  drawExtras(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.lineWidth = devicePixelRatio;
    ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    if (this.spec.threshold != null) {
      const y = u.valToPos(this.spec.threshold, "y", true);
      ctx.strokeStyle = colour("excluded");
      ctx.setLineDash([10, 4]);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      ctx.fillStyle = colour("excluded");
      ctx.textAlign = "left";
      ctx.fillText("threshold", bbox.left + 6 * devicePixelRatio, y - 4 * devicePixelRatio);
    }
    this.drawGaps(u);
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

  // Where nothing is compared the line has a gap, which says so.
  drawGaps(u) {
    const { ctx, bbox } = u;
    gapsOf(this.spec, this.board.store, u.scales.x).forEach(({ label, ink, from, to, row }) => {
      const [left, right] = [from, to].map((time) => u.valToPos(time, "x", true));
      ctx.fillStyle = `color-mix(in srgb, ${colour(ink)} 12%, transparent)`;
      ctx.fillRect(left, bbox.top, right - left, bbox.height);
      ctx.fillStyle = colour(ink);
      ctx.textAlign = "center";
      const width = ctx.measureText(label).width;
      const middle = Math.min(Math.max((left + right) / 2, bbox.left + width / 2 + 4), bbox.left + bbox.width - width / 2 - 4);
      const y = bbox.top + (14 + 14 * row) * devicePixelRatio;
      ctx.strokeStyle = colour("panel");
      ctx.lineWidth = 4 * devicePixelRatio;
      ctx.strokeText(label, middle, y);
      ctx.fillText(label, middle, y);
      ctx.lineWidth = devicePixelRatio;
    });
  }

  draw(low, high) {
    if (this.root.hidden) return;
    const { store } = this.board;
    const from = Math.max(0, store.at(low) - 1);
    const to = Math.min(store.times.length, store.at(high) + 1);
    const times = store.times.slice(from, to);
    const ends = farEnds(times, low, high);
    let isEmpty = true;
    let hasSigma = false;
    const data = [times];
    this.spec.lines.forEach((one, k) => {
      const column = this.columnOf(one, from, to);
      for (const { at, next, share } of ends) {
        const [from, to] = [column[at], column[next]];
        if (one.step) column[at] = at ? to : from;
        else if (from != null && to != null) column[at] = from + (to - from) * share;
      }
      const has = column.some((v) => v != null);
      if (one.band) hasSigma ||= has;
      else if (has || (one.lacks && store.column(one.lacks).slice(from, to).some((v) => v === 0))) isEmpty = false;
      if (one.optional) this.values[k].parentNode.hidden = !has;
      data.push(column);
    });
    for (const { at, time } of ends) times[at] = time;
    const words = isEmpty ? this.spec.empty?.(this.board.context) : "";
    this.empty.hidden = !words;
    this.empty.textContent = words ?? "";
    this.note.textContent = this.spec.note ?? (hasSigma ? this.spec.sigma ?? "" : "");
    this.chart.batch(() => {
      this.chart.setData(data, false);
      this.chart.setScale("x", { min: low, max: high });
    });
    this.showValues(this.chart.cursor.left >= 0 ? this.chart.cursor.idx : null);
  }

  columnOf(one, from, to) {
    const { store } = this.board;
    const column = store.column(one.column).slice(from, to);
    if (one.around) {
      const middle = store.column(one.around).slice(from, to);
      return column.map((v, k) => (v == null || middle[k] == null ? null : middle[k] + v * one.factor));
    }
    if (one.factor) return column.map((v) => (v == null ? null : v * one.factor));
    if (one.wraps) return turned(column);
    return one.centred ? turned(column, lowestOf(column)) : column;
  }

  // Beyond its threshold, the sensor at which a parity points the most; its window: 2.3 → G3, 64 s.
  pointed({ points, lacks }, value, time) {
    if (!points || time == null) return "";
    const { store } = this.board;
    const at = store.at(time);
    if (value == null) return store.column(lacks)[at] === 0 ? "no redundancy left" : "";
    const [sensor, power] = points.slice(1).map((name) => store.column(name)[at]);
    const suspect = value > this.spec.threshold && sensor ? ` → ${points[0]}${sensor},` : " in";
    return power == null ? "" : `${suspect} ${2 ** power} s`;
  }

  valueWords(one, value) {
    if (value == null) return "–";
    const { decimals } = this.spec;
    if (one.points) return parityWords(value);
    if (one.centred) return wrapped(Number(value.toFixed(decimals)), 0).toFixed(decimals); // 0.000, not 360.000
    return `${decimals ? value.toFixed(decimals).replace(/^-(0\.0+)$/, "$1") : figures(value, 3)}${one.scale === "ms" ? " ms" : ""}`;
  }

  // Values at the cursor, or the latest.
  showValues(place) {
    const data = this.chart.data;
    this.values.forEach((node, k) => {
      if (!node) return;
      const one = this.spec.lines[k];
      const column = data[k + 1];
      let at = place ?? column.length - 1;
      if (place == null && this.board.playedTo != null) at = Math.min(at, this.board.store.at(this.board.playedTo) - this.board.store.at(data[0][0]));
      const value = column[at];
      const more = this.pointed(one, value, data[0][at]);
      node.textContent = (value == null && more) || `${this.valueWords(one, value)}${more}`;
    });
  }
}

// The spans of a view in which a line lacks redundancy, each with its label.
export function gapsOf(spec, store, { min, max }) {
  const found = [];
  spec.lines.filter((one) => one.lacks).forEach((one, row) => {
    const column = store.column(one.lacks);
    let begun = null;
    const end = Math.min(store.times.length - 1, store.at(max));
    for (let k = store.at(min); k <= end; k++) {
      if (column[k] === 0) begun ??= store.times[k];
      const ends = begun != null && (column[k] !== 0 || k === end);
      if (!ends) continue;
      found.push({ label: `${one.label}: no redundancy left`, ink: one.ink, from: begun, to: Math.min(store.times[k], max), row });
      begun = null;
    }
  });
  return found;
}

export class Plots {
  constructor(store) {
    this.store = store;
    this.context = {}; // what is known of the run, for what an empty plot says
    this.zoomed = null;
    this.isHeld = false;
    this.playedTo = null; // of a recording
    this.plots = CHARTS.map((spec) => new Plot(spec, this));
    const observer = new ResizeObserver(() => this.resize()); // a legend of two lines leaves less
    for (const plot of this.plots) observer.observe(plot.area);
    addEventListener("resize", () => this.showChosen());
    for (const [words, seconds] of SPANS)
      $("spans").append(element("button", { onclick: () => this.setSpan(seconds), "data-span": seconds }, words));
    $("hold").onclick = () => this.hold();
    $("choose").onclick = () => this.choose();
    this.span = Number(recall("span", 60) ?? 60);
    this.hasSpan = recall("span", null) != null; // somebody has chosen it, before a reload
    this.zoomed = recall("zoom", null);
    this.showChosen();
    this.showSpan();
  }

  resize() {
    for (const plot of this.plots) plot.resize();
    this.draw();
  }

  setSpan(seconds) {
    keep("span", String(seconds));
    this.hasSpan = true;
    this.showOnly(seconds);
  }

  // A span that nobody has chosen.
  offerSpan(seconds) {
    if (!this.hasSpan) this.showOnly(seconds);
  }

  showOnly(seconds) {
    this.span = seconds;
    this.isHeld = false;
    this.zoom(null, null);
  }

  showSpan() {
    for (const button of $("spans").children) button.setAttribute("aria-pressed", !this.zoomed && Number(button.dataset.span) === this.span);
    $("hold").setAttribute("aria-pressed", this.isHeld);
  }

  hold() {
    this.isHeld = !this.isHeld;
    if (this.isHeld) this.held = this.zoomed ?? this.window();
    this.showSpan();
    this.draw();
  }

  zoom(low, high) {
    this.zoomed = low == null ? null : [low, high];
    keep("zoom", this.zoomed);
    if (this.isHeld && low != null) this.held = this.zoomed;
    if (low == null) this.isHeld = false;
    this.showSpan();
    this.draw();
  }

  // The band that is dragged shows in all plots.
  clearSelections() {
    for (const plot of this.plots) plot.chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }

  // ---- which are shown

  isChosen(spec) {
    return recall("plots", {}, true)[spec.id] ?? this.fitting().includes(spec.id);
  }

  // The most important ones, as many as there is height for.
  fitting() {
    const board = $("plots");
    const scrolls = getComputedStyle(board).overflowY === "visible";
    const some = BY_IMPORTANCE.filter((id) => id !== "estimator" || this.context.estimates !== false);
    return scrolls ? some : some.slice(0, Math.max(3, Math.floor((board.clientHeight + 6) / LEAST_HIGH)));
  }

  showChosen() {
    for (const plot of this.plots) plot.root.hidden = !this.isChosen(plot.spec);
    this.resize();
  }

  choose() {
    const list = $("choice").querySelector(".stack");
    list.replaceChildren(...this.plots.map(({ spec }) => {
      const choice = element("input", { type: "checkbox", onchange: () => {
        keep("plots", { ...recall("plots", {}, true), [spec.id]: choice.checked }, true);
        this.showChosen();
      } });
      choice.checked = this.isChosen(spec);
      return element("label", {}, choice, ` ${spec.title}`);
    }));
    $("choice").showModal();
  }

  // One plot over all; again: back.
  enlarge(plot) {
    const isLarge = plot != null && !plot.root.classList.contains("enlarged");
    for (const one of this.plots) {
      one.root.classList.toggle("enlarged", isLarge && one === plot);
      one.enlarger.setAttribute("aria-pressed", isLarge && one === plot);
    }
    this.resize();
  }

  window() {
    const { first, last } = this.store;
    if (this.span === Infinity) return [first, Math.max(last, first + 1)];
    const end = this.playedTo == null ? last : Math.min(last, Math.max(this.playedTo + this.span * 0.25, first + this.span));
    return [Math.max(end - this.span, 0), Math.max(end, this.span)];
  }

  // What is seen: from, to.
  get view() {
    const { first, last } = this.store;
    if (this.zoomed && last > 0 && (this.zoomed[0] > last || this.zoomed[1] < first)) this.zoomed = null; // of another run
    return this.isHeld ? this.held : this.zoomed ?? this.window();
  }

  draw() {
    const [low, high] = this.view;
    for (const plot of this.plots) plot.draw(low, high);
  }

  restyle() {
    for (const plot of this.plots) plot.build();
    this.draw();
  }
}
