// The tour: a card that says what is seen and what does it; the page itself shows it.

import { $, element, length } from "./parts.js";

const LOOK_MS = 250;

export class Tour {
  constructor(feed, store) {
    Object.assign(this, { feed, store, kept: {}, place: -1, isWaiting: false });
    const { hello, events } = feed.handlers;
    feed.handlers.hello = (message) => { hello(message); this.begin(message); };
    feed.handlers.events = (message) => { events(message); this.heard(message); };
  }

  begin({ tour, may_control: mayControl }) {
    if (!tour?.length || !mayControl || this.steps) return;
    this.steps = tour;
    this.card = element("aside", { id: "tour", "aria-live": "polite" });
    document.body.append(this.card);
    this.enter(0);
    setInterval(() => this.look(), LOOK_MS);
  }

  get step() {
    return this.steps[this.place];
  }

  // The position error at the latest row up to a bus time: a hurried run is far beyond the step's end.
  error(time) {
    const place = this.store.at(time + 1e-6) - 1;
    const [east, north] = ["error_east_m", "error_north_m"].map((name) => this.store.column(name)[place]);
    return length(east == null ? null : Math.hypot(east, north));
  }

  enter(place) {
    if (this.place >= 0 && this.step.keeps) this.kept[this.step.keeps] = this.error(this.step.until_s);
    document.querySelector(this.step?.look)?.classList.remove("toured");
    this.place = place;
    this.since = performance.now();
    this.isDone = false;
    const { step } = this;
    if (step.tab) document.querySelector(`[data-tab="${step.tab}"]`)?.click();
    if (this.isHurried) this.hurry(false);
    this.show();
    this.point(document.querySelector(step.look));
    if (step.order) this.order(step.order, step.fault ? { fault: step.fault } : {});
  }

  // Outline what is looked at, in view, and put the card where it does not cover it.
  point(looked) {
    this.card.classList.remove("aside");
    if (!looked) return;
    looked.classList.add("toured");
    looked.scrollIntoView({ block: "start" });
    const [a, b] = [looked, this.card].map((one) => one.getBoundingClientRect());
    const isCovered = a.left < b.right && a.right > b.left && a.top < b.bottom && a.bottom > b.top;
    this.card.classList.toggle("aside", isCovered);
  }

  async order(name, more) {
    const answer = await this.feed.order(name, more);
    if (answer.is_done) return;
    this.card.querySelector(".answer").hidden = false;
    this.card.querySelector(".answer").textContent = answer.text;
  }

  show() {
    const { step, place, steps } = this;
    const text = step.text.replace(/\{(\w+)\}/g, (_, name) => this.kept[name] ?? "–");
    const isLast = place === steps.length - 1;
    this.wait = element("button", { onclick: () => this.hold(), "aria-pressed": this.isWaiting }, "Wait here");
    this.next = element("button", { class: "main", onclick: () => this.ahead() }, "Skip ahead");
    const end = element("button", { onclick: () => this.close() }, "End the tour");
    this.card.replaceChildren(
      element("small", {}, `${place + 1} of ${steps.length}`), element("h2", {}, step.title), element("p", {}, text),
      element("code", {}, `$ ${step.command}`), element("p", { class: "answer refused", hidden: true }),
      element("div", { class: "row" }, ...(isLast ? [] : [this.next, this.wait]), end));
  }

  // What ends a step has come, and there was time to read.
  look() {
    const { step } = this;
    if (this.place === this.steps.length - 1) return;
    const byTime = step.until_s > 0 && this.store.last >= step.until_s;
    const isOver = byTime || this.isDone || (!step.until_s && !step.until_event);
    if (isOver && !this.isWaiting && performance.now() - this.since >= 1000 * step.dwell_s) this.enter(this.place + 1);
  }

  heard({ events }) {
    const words = this.steps && this.step.until_event;
    if (words && events.some(([, text]) => text.includes(words))) this.isDone = true;
  }

  hold() {
    this.isWaiting = !this.isWaiting;
    this.wait.setAttribute("aria-pressed", this.isWaiting);
  }

  ahead() {
    this.isWaiting = false;
    this.since = -Infinity;
    if (this.step.until_s > this.store.last || (this.step.until_event && !this.isDone)) this.hurry(true);
    this.look();
  }

  // As fast as it goes until the step ends, then as before.
  hurry(isHurried) {
    this.isHurried = isHurried;
    this.order("speed", { speed: isHurried ? 0 : this.step.speed });
  }

  close() {
    document.querySelector(this.step.look)?.classList.remove("toured");
    this.card.remove();
    this.look = () => {};
    this.heard = () => {};
  }
}
