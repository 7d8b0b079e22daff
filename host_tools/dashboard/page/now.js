// What is wrong now: how severe, since when, and the guide that explains it.

import { $, clock, element, setText } from "./parts.js";

const SIGNS = { bad: "✕", warning: "!", note: "·" };
const WORDS = { bad: "severe", warning: "warning", note: "note" };

export class Now {
  constructor() {
    this.guides = new Set();
  }

  begin(hello) {
    this.guides = new Set(hello.guides);
    this.shown = null;
  }

  update(troubles, hasHeard) {
    const now = JSON.stringify([troubles, hasHeard]);
    if (this.shown === now) return;
    this.shown = now;
    const calm = hasHeard ? "✓ nothing is wrong on the bus" : "nothing has been heard yet";
    const rows = troubles.length ? troubles.map((one) => this.row(one)) : [element("p", {}, calm)];
    $("tab-troubles").replaceChildren(element("div", { class: "stack troubles" }, ...rows));
    const count = troubles.filter((one) => one.severity !== "note").length;
    setText(document.querySelector('[data-tab="troubles"]'), count ? `Now (${count})` : "Now");
  }

  row({ text, severity, since_s, page }) {
    const more = [element("span", {}, WORDS[severity])];
    if (since_s != null) more.push(element("span", {}, `since ${clock(since_s)}`));
    const [name, section] = (page ?? "").split("#");
    if (this.guides.has(name)) more.push(element("a", { href: `guides/${page}`, target: "_blank", rel: "noopener" }, "what it means"));
    else if (name) more.push(element("span", {}, `guide: docs/${name}.md${section ? `, “${section.replaceAll("-", " ")}”` : ""}`));
    return element("div", { class: `trouble ${severity}` }, element("b", {}, SIGNS[severity]), element("div", {}, element("div", {}, text), element("small", {}, ...more)));
  }
}
