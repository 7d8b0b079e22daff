// What each sensor and each axis is like, in words and colour; the parity of each kind.

import { $, element, parityWords, setText } from "./parts.js";

const KINDS = [["gyros", "G", "Gyros"], ["accelerometers", "A", "Accelerometers"]];
const AXES = ["inner", "outer"];

export class Chips {
  constructor() {
    this.now = "";
  }

  update({ sensors, parity, axes }) {
    const now = JSON.stringify([sensors, axes]);
    if (now !== this.now) this.build(sensors, axes);
    this.now = now;
    for (const [kind] of KINDS) this.showParity(kind, parity[kind]);
  }

  build(sensors, axes) {
    this.parities = {};
    const kinds = KINDS.map(([kind, letter, words]) => {
      const bar = element("i", { class: "bar" }, element("i"));
      const text = element("small");
      this.parities[kind] = { bar, text };
      const chips = sensors[kind].map((state, k) => chip(`${letter}${k + 1}`, state, state, { "data-sensor": `${letter}${k + 1}` }));
      const columns = Math.min(8, Math.max(4, sensors[kind].length));
      return group(words, columns, chips, text, bar);
    });
    const ones = AXES.map((name) => {
      const [words, isSound] = axes[name] ?? ["not heard", null];
      return chip(name, words, isSound == null ? "not heard" : isSound ? "sound" : "suspect", { "data-axis": name });
    });
    $("chips").replaceChildren(...kinds, group("Axes", 2, ones));
  }

  // The parity is that of all sensors of a kind; only beyond the threshold does it point at one.
  showParity(kind, found) {
    const { bar, text } = this.parities[kind];
    const [ratio, suspect, seconds] = found ?? [null, 0, 0];
    bar.hidden = ratio == null;
    bar.classList.toggle("over", ratio > 1);
    bar.firstChild.style.width = `${Math.min(100, 50 * (ratio ?? 0))}%`;
    bar.title = "parity over its threshold, which is the mark";
    const who = ratio > 1 && suspect ? `, points at ${kind === "gyros" ? "G" : "A"}${suspect} the most` : "";
    setText(text, found == null ? "" : ratio == null ? "no redundancy left" : `parity ${parityWords(ratio)} × threshold in ${seconds} s${who}`);
  }
}

function group(words, columns, chips, ...more) {
  const row = element("div", { class: "chip-row" }, ...chips);
  row.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
  return element("div", { class: "kind" }, element("div", { class: "kind-head" }, element("b", {}, words), ...more), row);
}

function chip(name, words, state, attributes) {
  return element("div", { class: "chip", "data-state": state, ...attributes }, element("b", {}, name), " ", element("span", {}, words));
}
