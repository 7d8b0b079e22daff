// Faults by form, in groups with what each does; modes of the navigation computer.

import { $, clock, element, keyWords } from "./parts.js";

const GROUPS = ["gyros", "accelerometers", "turntable", "aiding", "on the wire"];
const FIRST = "gyro_bias";
const MODES = [["standby", "Standby"], ["navigate", "Navigate again"], ["rotation", "Start rotation"], ["no rotation", "Stop rotation"]];
const TARGETS = ["kind", "message", "node", "axis", "sensor", "direction"]; // which name a fault to remove

export class Faults {
  constructor(feed) {
    this.feed = feed;
    this.faults = [];
  }

  begin(hello) {
    this.hello = hello;
    const tab = $("tab-control");
    if (!hello.orders.includes("inject")) {
      const why = hello.source === "recording" ? "A recording takes no faults." : "This page may only look on. Start the dashboard with --control, and open it with the address that it prints.";
      tab.replaceChildren(element("div", { class: "stack" }, element("p", {}, why)));
      return;
    }
    this.fields = element("div", { class: "fields" });
    this.answer = element("div", { class: "answer", role: "status" });
    this.active = element("div");
    this.form = element("form", { onsubmit: (event) => { event.preventDefault(); this.inject("inject"); } }, this.fields,
      element("div", { class: "row" },
        element("button", { class: "main", type: "submit", id: "inject" }, "Inject"),
        element("button", { type: "button", onclick: () => this.inject("remove") }, "Remove")));
    const groups = GROUPS.map((group) => this.newGroup(group)).filter(Boolean);
    const modes = MODES.map(([mode, words]) => element("button", { onclick: () => this.give("mode", { mode }) }, words));
    tab.replaceChildren(element("div", { class: "stack" }, this.answer, this.active,
      element("div", { class: "row" }, element("button", { type: "button", onclick: () => this.give("clear_faults") }, "Clear all faults")),
      ...groups, ...(hello.orders.includes("mode") ? [element("h4", {}, "Mode of the navigation computer"), element("div", { class: "row" }, ...modes)] : [])));
    this.choose(FIRST);
    this.showFaults(this.faults);
  }

  newGroup(group) {
    const kinds = Object.entries(this.hello.forms).filter(([, form]) => form.group === group);
    if (!kinds.length) return null;
    const rows = kinds.map(([kind, { text }]) => element("div", { class: "fault", "data-kind": kind },
      element("button", { type: "button", "aria-expanded": "false", onclick: () => this.choose(kind) }, element("b", {}, kind), " ", element("span", {}, text))));
    const own = kinds.some(([kind]) => kind === FIRST);
    return element("details", { class: "faults", open: own }, element("summary", {}, group, " ", element("small", {}, String(kinds.length))), ...rows);
  }

  // The form is below the fault that is chosen.
  choose(kind) {
    this.kind = kind;
    for (const row of document.querySelectorAll(".fault")) row.firstChild.setAttribute("aria-expanded", row.dataset.kind === kind);
    document.querySelector(`.fault[data-kind="${kind}"]`).append(this.form);
    this.fields.replaceChildren(...this.hello.forms[kind].fields.map((field) => {
      const place = this.newInput(field);
      place.name = field.key;
      return element("label", {}, keyWords(field.key), place);
    }));
  }

  newInput(field) {
    if (field.type === "choice" || field.type === "message") {
      const words = field.type === "message" ? this.hello.message_names : field.choices;
      const first = field.is_needed ? [] : [element("option", { value: "" }, field.default ?? "all")];
      return element("select", {}, ...first, ...words.map((word) => element("option", {}, word)));
    }
    const hint = field.default ?? (field.key === "sensor" ? "all" : field.key === "for_s" ? "until removed" : field.key === "period_s" ? "always there" : "");
    const input = element("input", { type: "number", step: field.type === "whole" ? 1 : "any", min: field.minimum, max: field.maximum, placeholder: hint });
    if (field.key === "sensor") input.value = 3;
    return input;
  }

  inject(order) {
    const fault = { kind: this.kind };
    for (const place of this.fields.querySelectorAll("input, select")) {
      if (place.value === "") continue;
      fault[place.name] = place.type === "number" ? Number(place.value) : place.value;
    }
    this.give(order, { fault });
  }

  async give(order, more) {
    this.answer.className = "answer";
    this.answer.textContent = "waiting for the answer …";
    const answer = await this.feed.order(order, more);
    this.answer.className = `answer ${answer.is_done ? "done" : "refused"}`;
    this.answer.textContent = `${answer.is_done ? "✓" : "✗"} ${answer.text}${answer.at_s == null ? "" : `, ${clock(answer.at_s)}`}`;
  }

  showFaults(faults) {
    this.faults = faults;
    if (!this.active?.isConnected) return;
    this.active.replaceChildren(...faults.map((fault) => {
      const keys = Object.fromEntries(Object.entries(fault.keys).filter(([key]) => TARGETS.includes(key)));
      return element("div", { class: "active" }, element("span", {}, fault.words, element("small", {}, ` since ${clock(fault.at_s)}`)),
        element("button", { onclick: () => this.give("remove", { fault: keys }) }, "Remove"));
    }));
  }
}
