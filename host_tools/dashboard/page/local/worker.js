// Rehearses in the browser, and feeds the page as the dashboard's server does.

import { Events } from "./events.js";
import { Injection, Refused } from "./injection.js";
import { Machine, facts as loadFacts } from "./machine.js";
import { Quantities } from "./quantities.js";
import { Bus, Watch } from "./snapshot.js";
import { State } from "./state.js";

const TURN_MS = 33;
const STATE_EVERY = 8; // turns
const CHUNK = 20; // epochs between two looks at the clock and for events: no longer than a status lasts
const SPEED_MS = 1000; // over which the speed is taken, at least
const FIRST_SPEED = 10;

const tell = (kind, values) => postMessage(JSON.stringify({ kind, ...values }));

class Rehearsal {
  constructor(machine) {
    this.machine = machine;
    this.facts = machine.facts;
    this.wanted = FIRST_SPEED;
    this.shown = {};
    this.begin();
    setTimeout(() => this.turn());
  }

  begin() {
    const { machine } = this;
    machine.switchOn();
    this.injection = new Injection(machine);
    this.period_s = this.injection.period_s;
    this.bus = new Bus(machine);
    this.watch = new Watch(this.bus);
    this.quantities = new Quantities(machine, this.bus);
    this.events = new Events(machine, this.bus);
    this.state = new State(machine);
    this.turns = this.sequence = this.owed = 0;
    this.marks = [];
    this.sinceMs = performance.now();
    const { name, scenario } = machine.scenario;
    const scenarios = Object.values(this.facts.scenarios).map((one) => [one.name, one.scenario.title]);
    tell("hello", { ...this.facts.hello, name, scenario, scenarios });
    tell("events", { events: [], anew: true });
    tell("report", { faults: this.injection.active() });
    this.set("running", "");
  }

  set(phase, words) {
    this.phase = phase;
    tell("status", { phase, words, wanted_speed: this.wanted });
  }

  get time() {
    return this.bus.now.get() / 1e9;
  }

  turn() {
    const beginMs = performance.now();
    if (this.phase === "running") {
      this.advance(beginMs);
      this.tellRow();
      if (this.machine.epoch >= this.machine.scenario.epochs) this.finish("ended");
    }
    this.sinceMs = beginMs;
    if (this.turns++ % STATE_EVERY === 0) this.tellState();
    setTimeout(() => this.turn(), this.wanted ? Math.max(0, TURN_MS - (performance.now() - beginMs)) : 0);
  }

  // Run the epochs that are due, as far as a turn's time goes.
  advance(beginMs) {
    const { machine } = this;
    const last = machine.scenario.epochs;
    const due = this.wanted ? (((beginMs - this.sinceMs) / 1000) * this.wanted) / this.period_s : Infinity;
    this.owed = Math.min(this.owed + due, this.wanted ? (0.25 * this.wanted) / this.period_s : Infinity);
    while (this.owed >= 1 && machine.epoch < last && performance.now() - beginMs < TURN_MS) {
      const epochs = Math.min(CHUNK, Math.floor(this.owed), last - machine.epoch);
      machine.run(epochs);
      this.owed -= epochs;
      this.events.follow();
    }
    if (!this.wanted) this.owed = 0;
  }

  tellRow() {
    const row = this.quantities.row();
    const message = new ArrayBuffer(16 + row.byteLength);
    const head = new DataView(message);
    head.setUint8(0, 1);
    head.setUint16(2, row.length, true);
    head.setUint32(4, ++this.sequence, true);
    head.setFloat64(8, this.time, true);
    new Float32Array(message, 16).set(row);
    postMessage(message, [message]);
    this.tellEvents();
  }

  tellEvents() {
    const told = this.events.told();
    if (told) tell("events", told);
  }

  tellState() {
    const snapshot = this.watch.snapshot();
    tell("state", this.state.told(snapshot, this.injection.active().length, this.speed()));
    const { name, signal, level } = this.shown;
    const details = name && snapshot.details(name, signal, Math.min(2, level ?? 0));
    if (details) tell("message", details);
  }

  // Bus time over that of the wall clock.
  speed() {
    const now = [this.time, performance.now()];
    const before = this.marks.filter((mark) => now[1] - mark[1] >= SPEED_MS).at(-1);
    this.marks = [...this.marks.slice(-64), now];
    return before ? (1000 * (now[0] - before[0])) / (now[1] - before[1]) : null;
  }

  finish(words) {
    this.events.add(this.time, words, "note");
    this.tellEvents();
    this.set("ended", words);
  }

  // ---- orders

  carryOut({ id, order, ...more }) {
    if (order === "show") {
      this.shown = more;
      return;
    }
    const told = { id, order, is_done: true, at_s: null };
    try {
      Object.assign(told, this.orders[order]?.(more) ?? { is_done: false, text: `${order}: not for this source` });
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      Object.assign(told, { is_done: false, text: error.message });
    }
    tell("answer", told);
    if (!told.is_done) return;
    tell("report", { faults: this.injection.active() });
    if (!told.text || !this.sequence) return;
    this.events.add(Math.min(told.at_s ?? this.time, this.time), told.text, "order");
    this.tellEvents();
  }

  needRunning() {
    if (this.phase !== "running" && this.phase !== "paused") throw new Refused("no rehearsal is running");
  }

  orders = {
    start: () => {
      if (this.phase === "running") throw new Refused("start: a rehearsal is running already");
      this.begin();
      return { text: "the rehearsal has started" };
    },
    stop: () => {
      this.needRunning();
      this.set("ended", "stopped");
      return { text: "stopped" };
    },
    pause: () => {
      this.needRunning();
      this.set("paused", "paused");
      return { text: "paused", at_s: this.time };
    },
    speed: ({ speed }) => {
      this.needRunning();
      this.wanted = speed;
      this.owed = 0;
      this.set("running", "");
      return { text: speed ? `running at ${speed} × real time` : "as fast as it goes" };
    },
    list_faults: () => ({ text: "" }),
    clear_faults: () => {
      this.needRunning();
      this.injection.end();
      return { text: "all faults are removed", at_s: this.time };
    },
    inject: ({ fault }) => {
      this.needRunning();
      const [text, at_s] = this.injection.inject(fault);
      return { text, at_s };
    },
    remove: ({ fault }) => {
      this.needRunning();
      return { text: `${this.injection.remove(fault)} removed`, at_s: this.time };
    },
  };
}

async function main() {
  const waiting = [];
  onmessage = (event) => waiting.push(event.data);
  const facts = await loadFacts();
  const names = Object.keys(facts.scenarios);
  const name = names.includes(self.name) ? self.name : facts.first;
  const rehearsal = new Rehearsal(await Machine.load(facts, facts.scenarios[name]));
  onmessage = (event) => rehearsal.carryOut(JSON.parse(event.data));
  for (const text of waiting) rehearsal.carryOut(JSON.parse(text));
}

main().catch((error) => {
  setTimeout(() => { throw error; }); // for the console
  tell("hello", { source: "rehearsal", bus: "", columns: [], orders: [], forms: {}, guides: [], message_names: [], tour: [], may_control: false });
  tell("status", { phase: "failed", words: `the rehearsal cannot be loaded: ${error.message}` });
});
