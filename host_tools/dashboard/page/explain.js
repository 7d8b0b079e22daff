// "Why is the error 8 m?": a click on the position error, or in its plot, asks; a dialog answers.

import { $, clock, element } from "./parts.js";

const STILL_PX = 4;
const TWICE_MS = 300;

export class Explain {
  constructor(feed, plots, store) {
    Object.assign(this, { feed, plots, store });
    this.dialog = element("dialog", { id: "explain", "aria-label": "why the error is what it is" });
    document.body.append(this.dialog);
    feed.handlers.explaining = ({ done, of }) => this.progress(done, of);
    feed.handlers.explanation = (found) => this.show(found);
    const fact = $("error");
    fact.title = "why? (click)";
    fact.onclick = () => this.ask(plots.playedTo ?? store.last);
    this.follow($("plot-position")?.querySelector(".area"));
  }

  begin(hello) {
    this.may = hello.explains;
    document.body.toggleAttribute("data-explains", Boolean(this.may));
  }

  // A click that neither drags nor is the first of two.
  follow(area) {
    if (!area) return;
    let down = null;
    area.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; });
    area.addEventListener("click", (event) => {
      clearTimeout(this.waiting);
      if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > STILL_PX || event.detail > 1) return;
      const { chart } = this.plots.plots.find((plot) => plot.spec.id === "position");
      const time = chart.posToVal(event.clientX - chart.over.getBoundingClientRect().left, "x");
      this.waiting = setTimeout(() => this.ask(time), TWICE_MS);
    });
  }

  async ask(time) {
    if (!this.may || !(time > 0)) return;
    this.bar = element("progress", { max: 1, value: 0 });
    this.fill(`Why is the position off at ${clock(time)}?`, element("p", {}, "Running it again, with and without each source …"), this.bar);
    if (!this.dialog.open) this.dialog.showModal();
    const answer = await this.feed.order("explain", { time_s: time });
    if (!answer.is_done && !answer.text.includes("another instant")) this.fill("No explanation", element("p", { class: "answer refused" }, answer.text));
  }

  progress(done, of) {
    if (!this.bar) return;
    this.bar.max = of;
    this.bar.value = done;
  }

  show(found) {
    this.bar = null;
    const choice = element("div", { class: "group", role: "group", "aria-label": "error" },
      ...found.tables.map((table) => element("button", { onclick: () => this.table(found, table), "data-of": table.of }, table.of)));
    this.body = element("div", { class: "body" });
    this.fill("", choice, this.body, found.note ? element("p", { class: "answer refused" }, found.note) : "");
    this.table(found, found.tables[0]);
  }

  table(found, table) {
    for (const button of this.dialog.querySelectorAll("[data-of]")) button.setAttribute("aria-pressed", button.dataset.of === table.of);
    this.dialog.querySelector("h2").textContent = table.headline;
    const rows = table.rows.map(({ cells, share }, k) => {
      const bar = element("i", { class: share < 0 ? "against" : "" });
      bar.style.width = `${Math.min(100, 100 * Math.abs(share))}%`;
      return element("tr", { class: k === table.rows.length - 1 ? "sum" : "" },
        ...cells.slice(0, 4).map((cell, n) => element("td", { class: n ? "n" : "" }, cell)),
        element("td", { class: "share" }, bar, element("span", {}, cells[4])));
    });
    const head = ["source", ...table.headings, "share"].map((text, n) => element("th", { class: n ? "n" : "" }, text));
    this.body.replaceChildren(element("div", { class: "scroll" }, element("table", {}, element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...rows))),
      element("p", {}, element("small", {}, `share: of the ${table.share_of} error, along it; opposite ones are negative`)));
  }

  fill(title, ...parts) {
    this.dialog.replaceChildren(element("h2", {}, title), ...parts,
      element("form", { method: "dialog" }, element("button", {}, "Close")));
  }
}
