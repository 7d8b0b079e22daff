// Orders: start, pause, speed, stop; trouble codes, residuals; the time line. Each shows its answer.

import { Faults } from "./faults.js";
import { $, clock, element, figures } from "./parts.js";

const SPEEDS = [["¼ ×", 0.25], ["1 ×", 1], ["2 ×", 2], ["5 ×", 5], ["10 ×", 10], ["50 ×", 50], ["max", 0]];
const AGAIN_MS = 2000; // between two readings of the residuals
const REASONS = { excluded: "left out", absent: "absent", saturated: "at the end of its range" };

export class Control {
  constructor(feed) {
    this.feed = feed;
    this.faults = new Faults(feed);
    this.sensors = { gyros: [], accelerometers: [] }; // the state of each
    this.codes = null;
  }

  begin(hello) {
    this.hello = hello;
    this.may = new Set(hello.orders);
    this.buildDrive();
    this.faults.begin(hello);
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
    if (this.hello.scenarios?.length > 1) drive.append(this.newScenarioChoice());
    drive.append(this.startButton, this.pauseButton, this.speedChoice, this.stopButton);
  }

  newScenarioChoice() {
    const { scenarios, name } = this.hello;
    const choose = (event) => (location.search = new URLSearchParams({ scenario: event.target.value }));
    return element("select", { onchange: choose, id: "scenarios", title: "scenario", "aria-label": "scenario" },
      ...scenarios.map(([one, title]) => element("option", { value: one, title, selected: one === name }, one)));
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

  // Pause or go on; return whether there is something to pause.
  togglePause() {
    const phase = this.status?.phase;
    const isPaused = phase === "paused";
    if (!this.may.has("pause")) return false;
    if (this.hello.source === "recording") this.feed.order(isPaused || phase === "ended" ? "play" : "pause");
    else if (isPaused) this.drive("speed", { speed: this.status.wanted_speed });
    else if (phase === "running") this.drive("pause");
    else return false;
    return true;
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

  report(report) {
    if (report.faults) this.faults.showFaults(report.faults);
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
    const why = may ? [] : [element("p", {}, this.hello.place ? "Trouble codes are read over UDS, which this page does not speak: rrins dashboard does." : "Codes are read over the bus, which this page may only look at.")];
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
    const rows = [["gyros", "G", "°/h"], ["accelerometers", "A", "µg"]].flatMap(([kind, letter, unit]) => {
      const isCompared = residuals[kind].some(([, threshold]) => threshold);
      return this.sensors[kind].map((state, k) => {
        const [residual, threshold] = residuals[kind][k] ?? [];
        const name = element("td", {}, `${letter}${k + 1}`);
        if (!threshold) {
          const why = REASONS[state] ?? (isCompared ? "not compared" : "not compared: no redundancy left");
          return element("tr", { class: "silent" }, name, element("td", { colspan: 3 }, why));
        }
        const bar = element("i");
        bar.style.width = `${Math.min(100, (50 * Math.abs(residual)) / threshold)}%`;
        return element("tr", { class: Math.abs(residual) > threshold ? "trouble" : "" }, name,
          element("td", { class: "n" }, `${figures(residual, 3)} ${unit}`), element("td", { class: "n" }, `± ${figures(threshold, 3)} ${unit}`),
          element("td", { class: "wide" }, element("i", { class: "bar" }, bar)));
      });
    });
    const head = element("tr", {}, ...["sensor", "residual", "threshold", ""].map((text, k) => element("th", { class: k % 3 ? "n" : "" }, text)));
    this.residuals.replaceChildren(element("table", { id: "residuals" }, element("thead", {}, head), element("tbody", {}, ...rows)));
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
