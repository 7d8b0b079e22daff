// Orders: start, pause, speed, stop; faults by form; modes; trouble codes. Each shows its answer.

import { $, clock, element, figures, keyWords } from "./parts.js";

const SPEEDS = [["¼ ×", 0.25], ["1 ×", 1], ["2 ×", 2], ["5 ×", 5], ["10 ×", 10], ["50 ×", 50], ["max", 0]];
const AGAIN_MS = 2000; // between two readings of the residuals
const MODES = [["standby", "Standby"], ["navigate", "Navigate again"], ["rotation", "Start rotation"], ["no rotation", "Stop rotation"]];

export class Control {
  constructor(feed) {
    this.feed = feed;
    this.faults = [];
    this.codes = null;
  }

  begin(hello) {
    this.hello = hello;
    this.may = new Set(hello.orders);
    this.buildDrive();
    this.buildFaults();
    this.buildCodes();
    this.buildTimeline();
    if (this.may.has("list_faults") && hello.source === "bus") this.feed.order("list_faults");
  }

  // ---- the run itself

  buildDrive() {
    const drive = $("drive");
    drive.hidden = !this.may.has("pause") || this.hello.source === "recording";
    drive.replaceChildren();
    if (drive.hidden) return;
    this.startButton = element("button", { class: "main", onclick: () => this.drive("start") }, "Start");
    this.pauseButton = element("button", { onclick: () => this.togglePause(), title: "p" }, "Pause");
    this.stopButton = element("button", { class: "danger", onclick: () => this.drive("stop") }, "Stop");
    this.speedChoice = this.newSpeedChoice();
    drive.append(this.startButton, this.pauseButton, this.speedChoice, this.stopButton);
  }

  newSpeedChoice() {
    const choose = (event) => this.drive("speed", { speed: Number(event.target.value) });
    return element("select", { onchange: choose, title: "speed, as a factor of real time", "aria-label": "speed" },
      ...SPEEDS.map(([words, value]) => element("option", { value }, words)));
  }

  async drive(order, more) {
    this.isWaiting = true;
    this.refresh();
    const answer = await this.feed.order(order, more);
    this.isWaiting = false;
    this.refresh();
    if (!answer.is_done) this.complain?.(answer.text);
  }

  togglePause() {
    if (!this.status || !this.may.has("pause")) return;
    const goesOn = this.status.phase === "paused" || this.status.phase === "ended";
    if (this.hello.source === "recording") this.feed.order(goesOn ? "play" : "pause");
    else if (goesOn) this.drive("speed", { speed: this.status.wanted_speed });
    else this.drive("pause");
  }

  setStatus(status) {
    this.status = status;
    this.refresh();
    if (this.range && !this.isSeeking && status.at_s != null) {
      this.range.value = status.at_s;
      this.playButton.textContent = status.phase === "running" ? "❚❚" : "▶";
      this.played.textContent = `${clock(status.at_s)} of ${clock(this.hello.last_s)}`;
    }
  }

  refresh() {
    const phase = this.status?.phase;
    const runs = phase === "running" || phase === "paused";
    if (this.startButton?.isConnected) {
      this.startButton.hidden = runs || phase === "starting";
      this.pauseButton.hidden = this.stopButton.hidden = !runs;
      this.pauseButton.textContent = phase === "paused" ? "Go on" : "Pause";
      for (const one of [this.startButton, this.pauseButton, this.stopButton]) one.disabled = this.isWaiting;
    }
    const wanted = this.status?.wanted_speed;
    if (this.speedChoice && document.activeElement !== this.speedChoice && wanted != null) {
      if (![...this.speedChoice.options].some((one) => Number(one.value) === wanted))
        this.speedChoice.append(element("option", { value: wanted }, `${wanted} ×`));
      this.speedChoice.value = String(wanted);
    }
  }

  // ---- faults and modes

  buildFaults() {
    const tab = $("tab-control");
    tab.replaceChildren();
    const stack = element("div", { class: "stack" });
    tab.append(stack);
    if (!this.may.has("inject")) {
      const why = this.hello.source === "recording" ? "A recording takes no faults." : "This page may only look on. Start the dashboard with --control, and open it with the address that it prints.";
      stack.append(element("p", {}, why));
      return;
    }
    const groups = new Map();
    for (const [kind, { group }] of Object.entries(this.hello.forms)) {
      if (!groups.has(group)) groups.set(group, []);
      groups.get(group).push(kind);
    }
    const order = ["gyros", "accelerometers", "turntable", "aiding", "on the wire"];
    this.kindChoice = element("select", { id: "fault-kind", onchange: () => this.buildFields() },
      ...order.filter((group) => groups.has(group)).map((group) => element("optgroup", { label: group }, ...groups.get(group).map((kind) => element("option", { value: kind }, kind)))));
    this.kindChoice.value = "gyro_bias";
    this.fields = element("div", { class: "fields" });
    this.answer = element("div", { class: "answer", role: "status" });
    this.active = element("div");
    const form = element("form", { onsubmit: (event) => { event.preventDefault(); this.inject("inject"); } },
      element("div", { class: "stack-inner" },
        element("label", {}, element("small", {}, "kind of fault "), this.kindChoice)), this.fields,
      element("div", { class: "row" },
        element("button", { class: "main", type: "submit", id: "inject" }, "Inject"),
        element("button", { type: "button", onclick: () => this.inject("remove") }, "Remove"),
        element("button", { type: "button", onclick: () => this.give("clear_faults") }, "Clear all faults")));
    form.className = "stack";
    form.style.padding = "0";
    const modes = MODES.map(([mode, words]) => element("button", { onclick: () => this.give("mode", { mode }) }, words));
    stack.append(form, this.answer, this.active, element("h4", {}, "Mode of the navigation computer"), element("div", { class: "row" }, ...modes));
    this.buildFields();
    this.showFaults(this.faults);
  }

  buildFields() {
    this.fields.replaceChildren();
    for (const field of this.hello.forms[this.kindChoice.value].fields) {
      const place = this.newInput(field);
      place.name = field.key;
      this.fields.append(element("label", {}, keyWords(field.key), place));
    }
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
    const fault = { kind: this.kindChoice.value };
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
    this.answer.textContent = `${answer.is_done ? "✓" : "✗"} ${answer.text}`;
  }

  showFaults(faults) {
    this.faults = faults;
    if (!this.active?.isConnected) return;
    this.active.replaceChildren(...faults.map((fault) => {
      const keys = Object.fromEntries(Object.entries(fault.keys).filter(([key]) => ["kind", "message", "node", "axis", "sensor", "direction"].includes(key)));
      return element("div", { class: "active" }, element("span", {}, fault.words, element("small", {}, ` since ${clock(fault.at_s)}`)),
        element("button", { onclick: () => this.give("remove", { fault: keys }) }, "Remove"));
    }));
  }

  report(report) {
    if (report.faults) this.showFaults(report.faults);
    if (report.codes) this.showCodes(report.codes);
    if (report.residuals) this.showResiduals(report.residuals);
  }

  // ---- trouble codes, residuals

  buildCodes() {
    const tab = $("tab-codes");
    this.codeList = element("div");
    this.codeAnswer = element("div", { class: "answer", role: "status" }, "not read yet");
    const may = this.may.has("read_codes");
    const ask = async (order) => {
      this.codeAnswer.className = "answer";
      this.codeAnswer.textContent = "asking the navigation computer …";
      const answer = await this.feed.order(order);
      this.codeAnswer.className = `answer ${answer.is_done ? "done" : "refused"}`;
      this.codeAnswer.textContent = `${answer.is_done ? "✓" : "✗"} ${answer.text}`;
    };
    const buttons = element("div", { class: "row" },
      element("button", { class: "main", onclick: () => ask("read_codes"), disabled: !may, id: "read-codes" }, "Read trouble codes"),
      element("button", { class: "danger", onclick: () => ask("clear_codes"), disabled: !may }, "Clear"),
      element("button", { class: "main", onclick: () => ask("read_residuals"), disabled: !may, id: "read-residuals" }, "Read residuals"));
    this.again = element("input", { type: "checkbox", disabled: !may, id: "again" });
    this.residuals = element("div");
    buttons.append(element("label", { title: "while this tab is open" }, this.again, ` each ${AGAIN_MS / 1000} s`));
    const why = may ? [] : [element("p", {}, "Codes are read over the bus, which this page may only look at.")];
    tab.replaceChildren(element("div", { class: "stack" }, buttons, this.codeAnswer, ...why, this.residuals, this.codeList));
    if (this.codes) this.showCodes(this.codes);
  }

  // The residuals again and again, if that is asked for and somebody sees them.
  async keepReading() {
    const now = Date.now();
    if (!this.again?.checked || $("tab-codes").hidden || document.hidden || now < (this.readAgainMs ?? 0)) return;
    this.readAgainMs = Infinity;
    const answer = await this.feed.order("read_residuals");
    this.readAgainMs = Date.now() + AGAIN_MS;
    if (answer.is_done) return;
    this.again.checked = false;
    this.codeAnswer.className = "answer refused";
    this.codeAnswer.textContent = `✗ ${answer.text}`;
  }

  showResiduals(residuals) {
    const rows = [];
    for (const [kind, letter, unit] of [["gyros", "G", "°/h"], ["accelerometers", "A", "µg"]])
      residuals[kind].forEach(([residual, threshold], k) => {
        if (!threshold) return;
        const bar = element("i");
        bar.style.width = `${Math.min(100, (50 * Math.abs(residual)) / threshold)}%`;
        rows.push(element("tr", { class: Math.abs(residual) > threshold ? "trouble" : "" }, element("td", {}, `${letter}${k + 1}`),
          element("td", { class: "n" }, `${figures(residual, 3)} ${unit}`), element("td", { class: "n" }, `± ${figures(threshold, 3)} ${unit}`),
          element("td", { class: "wide" }, element("i", { class: "bar" }, bar))));
      });
    const head = element("tr", {}, ...["sensor", "residual", "threshold", ""].map((text, k) => element("th", { class: k % 3 ? "n" : "" }, text)));
    this.residuals.replaceChildren(rows.length ? element("table", { id: "residuals" }, element("thead", {}, head), element("tbody", {}, ...rows))
      : element("p", {}, "No sensor is compared with others."));
  }

  showCodes(codes) {
    this.codes = codes;
    this.codeList.replaceChildren(...codes.map((code) => element("details", {},
      element("summary", {}, element("b", {}, code.code), ` ${code.name} `, element("small", {}, code.is_failed ? "failed now" : "passed now")),
      element("div", {}, code.text),
      element("small", {}, code.status.map((word) => word.replaceAll("_", " ")).join(", ")),
      ...Object.entries(code.freeze_frames).map(([record, frame]) => element("pre", {}, `freeze frame, ${record}\n${frameWords(frame)}`)))));
  }

  // ---- the time line of a recording

  buildTimeline() {
    const foot = $("timeline");
    foot.hidden = this.hello.source !== "recording";
    this.range = null;
    foot.replaceChildren();
    if (foot.hidden) return;
    const { first_s, last_s } = this.hello;
    this.playButton = element("button", { onclick: () => this.togglePause(), title: "p", "aria-label": "play or pause" }, "❚❚");
    this.range = element("input", { type: "range", min: first_s, max: last_s, step: Math.max(0.01, (last_s - first_s) / 5000), "aria-label": "time" });
    this.range.oninput = () => { this.isSeeking = true; this.seek(Number(this.range.value)); };
    this.range.onchange = () => (this.isSeeking = false);
    this.ticks = element("div", { class: "ticks" });
    this.played = element("small");
    this.speedChoice = this.newSpeedChoice();
    foot.append(this.playButton, this.speedChoice, element("div", { class: "line" }, this.range, this.ticks), this.played);
  }

  seek(time_s) {
    if (this.may.has("seek")) this.feed.order("seek", { time_s: Math.max(0, time_s) });
  }

  markEvents(events) {
    if (!this.range) return;
    const { first_s, last_s } = this.hello;
    this.ticks.replaceChildren(...events.map(([time, text, weight]) => {
      const tick = element("i", { class: weight, title: text });
      tick.style.left = `${(100 * (time - first_s)) / (last_s - first_s || 1)}%`;
      return tick;
    }));
  }
}

// Nine figures of a number above one, such as a latitude; four of a smaller one.
function shortened(value) {
  if (typeof value !== "number" || Number.isInteger(value)) return String(value);
  return String(Number(value.toPrecision(Math.abs(value) >= 1 ? 9 : 4)));
}

// A list, with equal values in a row counted: 0.16, 0.2, 0 × 12.
function listed(values) {
  const runs = [];
  for (const text of values.map(shortened)) {
    if (runs.at(-1)?.text === text) runs.at(-1).count++;
    else runs.push({ text, count: 1 });
  }
  return runs.map(({ text, count }) => (count > 1 ? `${text} × ${count}` : text)).join(", ");
}

function frameWords(frame) {
  return Object.entries(frame)
    .map(([name, values]) => `${name}: ${Object.entries(values).map(([key, value]) => `${key} ${Array.isArray(value) ? `[${listed(value)}]` : shortened(value)}`).join(", ")}`)
    .join("\n");
}
