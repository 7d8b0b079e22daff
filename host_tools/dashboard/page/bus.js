// The table of messages; one of them with its signals, and a signal over time.

import { $, breakable, colour, element, figures, setText, span } from "./parts.js";

const HEAD = [["ID", "hex"], ["message", "name"], ["rate / Hz", "n"], ["age", "n"], ["errors", "n"], ["1 min", "spark"], ["payload", "hex payload"]];
const SPANS = ["1 min", "10 min", "100 min"];
const SILENT = 1;
const TROUBLE = 2;
const BROKEN = 4;
const SPARK_MS = 1000; // between two points of a rate
const SPARK_POINTS = 60;
const [WIDE, HIGH] = [56, 13]; // px, of a small plot

function sparkline() {
  const svg = document.createElementNS("http:" + "//www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", `0 0 ${WIDE} ${HIGH}`);
  svg.setAttribute("class", "sparkline");
  svg.append(document.createElementNS(svg.namespaceURI, "path"));
  return svg;
}

// Draw values, newest last, between the smallest and the largest; null: a gap.
function drawSpark(svg, values, count, least) {
  const known = values.filter((v) => v != null);
  const low = Math.min(...known, ...(least == null ? [] : [least]));
  const high = Math.max(...known);
  const x = (k) => (WIDE * (k + count - values.length)) / (count - 1);
  const y = (v) => (high > low ? HIGH - 1 - ((HIGH - 2) * (v - low)) / (high - low) : HIGH / 2);
  const points = values.map((v, k) => (v == null ? "" : `${values[k - 1] == null ? "M" : "L"}${x(k).toFixed(1)} ${y(v).toFixed(1)}h.1`));
  svg.firstChild.setAttribute("d", points.join(""));
}

export class BusTable {
  constructor(feed) {
    this.feed = feed;
    this.rows = new Map();
    this.shown = { name: null, signal: null, level: 0 };
    this.body = element("tbody");
    this.detail = element("div", { class: "detail", hidden: true });
    const head = element("tr", {}, ...HEAD.map(([text, kind]) => element("th", { class: kind }, text)));
    $("tab-bus").append(this.detail, element("table", { class: "messages" }, element("thead", {}, head), this.body));
  }

  clear() {
    this.rows.clear();
    this.body.replaceChildren();
    this.show({});
  }

  update(messages, time) {
    if (time < this.time || time > this.time + 30) for (const row of this.rows.values()) row.rates = []; // sought
    this.time = time;
    const isDue = !(Date.now() < this.sparkMs + SPARK_MS);
    if (isDue) this.sparkMs = Date.now();
    for (const [identifier, label, rate, age, errors, flags, payload] of messages) {
      const row = this.rows.get(identifier + label) ?? this.addRow(identifier, label);
      [identifier, label, rate == null ? "–" : figures(rate), span(age), String(errors)]
        .forEach((text, k) => setText(row.children[k], text));
      this.showPayload(row, payload);
      if (isDue) this.showRate(row, rate);
      const kind = flags & (TROUBLE | BROKEN) ? "trouble" : flags & SILENT ? "silent" : "";
      const wanted = `${kind}${label === this.shown.name ? " chosen" : ""}`.trim();
      if (row.className !== wanted) row.className = wanted;
    }
  }

  // The bytes; those that have changed since the last look are marked, in the detail each bit.
  showPayload(row, payload) {
    const bytes = payload.match(/../g) ?? [];
    const before = row.bytes ?? bytes;
    const cell = row.lastChild;
    while (cell.children.length < bytes.length) cell.append(element("i"));
    while (cell.children.length > bytes.length) cell.lastChild.remove();
    bytes.forEach((byte, k) => {
      setText(cell.children[k], byte);
      const name = before[k] === byte ? "" : "changed";
      if (cell.children[k].className !== name) cell.children[k].className = name;
    });
    if (row.children[1].textContent === this.shown.name) this.showBits(bytes, before);
    row.bytes = bytes;
  }

  showBits(bytes, before) {
    if (!this.bits?.isConnected) return;
    while (this.bits.children.length < bytes.length)
      this.bits.append(element("div", {}, element("b"), element("span", {}, ...Array.from({ length: 8 }, () => element("i")))));
    bytes.forEach((byte, k) => {
      const [hex, bits] = this.bits.children[k].children;
      const [now, then] = [byte, before[k] ?? byte].map((text) => parseInt(text, 16));
      setText(hex, byte);
      [...bits.children].forEach((bit, n) => {
        const mask = 0x80 >> n;
        bit.className = `${now & mask ? "one" : ""} ${(now ^ then) & mask ? "changed" : ""}`;
      });
    });
  }

  showRate(row, rate) {
    row.rates = [...(row.rates ?? []), rate].slice(-SPARK_POINTS);
    drawSpark(row.children[5].firstChild, row.rates, SPARK_POINTS, 0);
  }

  addRow(identifier, label) {
    const row = element("tr", { onclick: () => this.show({ name: label }), tabindex: 0 },
      ...HEAD.map(([, kind]) => element("td", { class: kind }, ...(kind === "spark" ? [sparkline()] : []))));
    row.onkeydown = (event) => event.key === "Enter" && this.show({ name: label });
    row.children[1].append(...breakable(label));
    this.rows.set(identifier + label, row);
    const all = [...this.rows.keys()].sort();
    const after = this.rows.get(all[all.indexOf(identifier + label) + 1]);
    this.body.insertBefore(row, after?.isConnected ? after : null);
    return row;
  }

  show(what) {
    this.shown = { name: null, signal: null, level: this.shown.level, ...what };
    this.detail.hidden = !this.shown.name;
    this.detail.replaceChildren();
    this.feed.order("show", this.shown);
  }

  // A message in detail, as the server sends it four times a second.
  message(message) {
    if (message.name !== this.shown.name) return;
    const key = [message.name, ...message.signals.map(([name]) => name)].join();
    if (this.detail.dataset.key !== key || !this.detail.firstChild) this.buildDetail(message, key);
    message.signals.forEach(([, text], k) => {
      setText(this.values[k], text);
      drawSpark(this.sparks[k], message.sparks[k], message.sparks[k].length);
    });
    this.drawOverTime(message);
  }

  buildDetail(message, key) {
    this.detail.dataset.key = key;
    this.values = [];
    this.sparks = [];
    const body = element("tbody");
    for (const [name, text, low, high, unit, comment] of message.signals) {
      const value = element("td", { class: "n" }, text);
      this.values.push(value);
      this.sparks.push(sparkline());
      const choose = () => { this.shown.signal = name; this.feed.order("show", this.shown); };
      body.append(element("tr", { onclick: choose, title: `${comment}\nClick: over time` }, element("td", {}, name), element("td", { class: "spark" }, this.sparks.at(-1)), value));
    }
    this.plot = element("canvas", { class: "over-time", hidden: true });
    this.plotHead = element("small");
    const spans = SPANS.map((words, level) =>
      element("button", { onclick: () => { this.shown.level = level; this.feed.order("show", this.shown); } }, words));
    this.spans = element("span", { class: "group" }, ...spans);
    this.bits = element("div", { class: "bits", title: "the payload, bit 7 of each byte first; marked: changed since the last look" });
    this.detail.replaceChildren(
      element("h4", {}, element("span", {}, message.name, " ", element("small", {}, message.text)),
        element("button", { onclick: () => this.show({}), "aria-label": "close" }, "×")),
      this.bits, element("div", { class: "row" }, this.spans, this.plotHead), this.plot, element("table", { class: "signals" }, body));
  }

  drawOverTime(message) {
    const bins = message.over_time;
    this.plot.hidden = !bins;
    this.plotHead.textContent = bins ? "" : "choose a signal to see it over time";
    [...this.spans.children].forEach((button, k) => button.setAttribute("aria-pressed", k === this.shown.level));
    if (!bins) return;
    const { clientWidth: width, clientHeight: height } = this.plot;
    const ratio = devicePixelRatio;
    this.plot.width = width * ratio;
    this.plot.height = height * ratio;
    const ctx = this.plot.getContext("2d");
    ctx.scale(ratio, ratio);
    const known = bins.filter(Boolean);
    const low = Math.min(...known.map((bin) => bin[0]));
    const high = Math.max(...known.map((bin) => bin[1]));
    const unit = message.signals.find(([name]) => name === message.signal)?.[4] ?? "";
    this.plotHead.textContent = known.length ? `${message.signal}: ${figures(low)} … ${figures(high)} ${unit}` : message.signal;
    const y = (value) => height - 6 - ((value - low) / (high - low || 1)) * (height - 12);
    ctx.fillStyle = colour("east");
    bins.forEach((bin, k) => {
      if (!bin) return;
      const top = y(bin[1]);
      ctx.fillRect((k * width) / bins.length, top - 1, Math.max(1, width / bins.length), Math.max(2, y(bin[0]) - top + 1));
    });
  }
}
