// The table of messages; one of them with its signals, and a signal over time.

import { $, colour, element, figures, setText } from "./parts.js";

const HEAD = [["identifier", ""], ["message", ""], ["rate / Hz", "n"], ["age / s", "n"], ["errors", "n"], ["payload", ""]];
const SPANS = ["1 min", "10 min", "100 min"];
const SILENT = 1;
const TROUBLE = 2;
const BROKEN = 4;

export class BusTable {
  constructor(feed) {
    this.feed = feed;
    this.rows = new Map();
    this.shown = { name: null, signal: null, level: 0 };
    this.body = element("tbody");
    this.detail = element("div", { class: "detail", hidden: true });
    const head = element("tr", {}, ...HEAD.map(([text, kind]) => element("th", { class: kind }, text)));
    $("tab-bus").append(this.detail, element("table", {}, element("thead", {}, head), this.body));
  }

  clear() {
    this.rows.clear();
    this.body.replaceChildren();
    this.show({});
  }

  update(messages) {
    for (const [identifier, label, rate, age, errors, flags, payload] of messages) {
      let row = this.rows.get(identifier + label);
      if (!row) row = this.addRow(identifier, label);
      const bytes = payload.replace(/(..)(?=.)/g, "$1 ");
      [identifier, label, rate == null ? "–" : figures(rate), age < 0.0005 ? "0" : figures(age, 3), String(errors), bytes]
        .forEach((text, k) => setText(row.children[k], text));
      const kind = flags & (TROUBLE | BROKEN) ? "trouble" : flags & SILENT ? "silent" : "";
      const wanted = `${kind}${label === this.shown.name ? " chosen" : ""}`.trim();
      if (row.className !== wanted) row.className = wanted;
    }
  }

  addRow(identifier, label) {
    const row = element("tr", { onclick: () => this.show({ name: label }), tabindex: 0 },
      ...HEAD.map(([, kind], k) => element("td", { class: k === 5 || k === 0 ? "hex" : kind, title: k === 1 ? label : null })));
    row.onkeydown = (event) => event.key === "Enter" && this.show({ name: label });
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
    if (this.detail.dataset.name !== message.name || !this.detail.firstChild) this.buildDetail(message);
    message.signals.forEach(([, text], k) => setText(this.values[k], text));
    this.drawOverTime(message);
  }

  buildDetail(message) {
    this.detail.dataset.name = message.name;
    this.values = [];
    const body = element("tbody");
    for (const [name, text, low, high, unit, comment] of message.signals) {
      const value = element("td", { class: "n" }, text);
      this.values.push(value);
      const choose = () => { this.shown.signal = name; this.feed.order("show", this.shown); };
      body.append(element("tr", { onclick: choose, title: `${comment}\nClick: over time` }, element("td", {}, name), value));
    }
    this.plot = element("canvas", { class: "over-time", hidden: true });
    this.plotHead = element("small");
    const spans = SPANS.map((words, level) =>
      element("button", { onclick: () => { this.shown.level = level; this.feed.order("show", this.shown); } }, words));
    this.spans = element("span", { class: "group", hidden: true }, ...spans);
    this.detail.replaceChildren(
      element("h4", {}, message.name, element("small", {}, message.text),
        element("button", { onclick: () => this.show({}), "aria-label": "close" }, "×")),
      element("div", { class: "row" }, this.spans, this.plotHead), this.plot, element("table", {}, body));
  }

  drawOverTime(message) {
    const bins = message.over_time;
    this.plot.hidden = this.spans.hidden = !bins;
    this.plotHead.textContent = bins ? "" : "choose a signal to see it over time";
    if (!bins) return;
    [...this.spans.children].forEach((button, k) => button.setAttribute("aria-pressed", k === this.shown.level));
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
