// The state of the bus at one moment, from the statistics that the rehearsal keeps of its frames.

export const hexadecimal = (octets) => Array.from(octets, (one) => one.toString(16).padStart(2, "0")).join("");
const rounded = (value) => (value == null ? null : Number(value.toPrecision(4)));
const scaled = (raw, { scale, offset }) => Number((raw * scale + offset).toPrecision(13));

const ENTRY = ["can_id", "length", "is_sound", "count", "crc_errors", "lost", "out_of_turn", "first_ns", "last_ns", "period_ns"];
const MARKS = 16;

// The contract's messages and signals, and where their statistics are.
export class Bus {
  constructor(machine) {
    const { facts } = machine;
    this.facts = facts;
    this.messages = facts.messages;
    this.signals = [];
    this.rows = new Map();
    for (const message of facts.messages) {
      for (const signal of message.signals) {
        this.rows.set(`${message.name}.${signal.name}`, this.signals.length);
        this.signals.push({ ...signal, message: message.name });
      }
    }
    this.valid = this.signals.map(({ message, valid_if: flag }) => (flag ? this.rows.get(`${message}.${flag}`) : -1));
    const of = (path) => machine.field("tally", path);
    this.now = of("now_ns");
    this.first = of("first_ns");
    this.busy = of("load.busy_ns");
    [this.raw, this.low, this.high, this.changed] = ["raw", "low", "high", "changed_ns"].map((name) => of(`signals.${name}`));
    this.entry = Object.fromEntries(ENTRY.map((name) => [name, of(`entries.${name}`)]));
    this.data = of("entries.data");
    this.bin = of("entries.bin");
    this.past = { low: of("histories.low"), high: of("histories.high") };
  }

  // The latest value of a signal by its row; NaN before it was on the bus, or while it means nothing.
  latest(row) {
    if (this.low.get(row) > this.high.get(row)) return NaN;
    if (this.valid[row] >= 0 && this.raw.get(this.valid[row]) === 0) return NaN;
    return this.raw.get(row) * this.signals[row].scale + this.signals[row].offset;
  }
}

// Takes snapshots; rates are taken since an earlier one.
export class Watch {
  constructor(bus) {
    this.bus = bus;
    this.marks = [];
  }

  snapshot() {
    const { bus } = this;
    const now = bus.now.get();
    const columns = Object.fromEntries(ENTRY.map((name) => [name, bus.messages.map((_, k) => bus.entry[name].get(k))]));
    const mark = { now, columns };
    const empty = { now: bus.first.get(), columns: Object.fromEntries(ENTRY.map((name) => [name, bus.messages.map(() => 0)])) };
    const before = this.marks.filter((one) => now - one.now >= bus.facts.window_ns).at(-1) ?? (this.marks.length === MARKS ? this.marks[0] : empty);
    if (!this.marks.length || now - this.marks.at(-1).now >= bus.facts.window_ns / 8) {
      this.marks.push(mark);
      if (this.marks.length > MARKS) this.marks.shift();
    }
    return new Snapshot(bus, now, columns, before.columns);
  }
}

class Snapshot {
  constructor(bus, now, columns, before) {
    this.bus = bus;
    this.now = now;
    this.watched_s = (now - bus.first.get()) / 1e9;
    const [periods, least] = bus.facts.silent;
    this.messages = [];
    for (let k = 0; k < bus.messages.length; k++) {
      const one = Object.fromEntries(ENTRY.map((name) => [name, columns[name][k]]));
      const old = Object.fromEntries(ENTRY.map((name) => [name, before[name][k]]));
      if (!one.count) continue;
      const age = now - one.last_ns;
      const isSilent = one.period_ns > 0 && age > periods * one.period_ns && age > least;
      const errors = one.lost + one.out_of_turn + one.crc_errors;
      const isWrong = errors > old.lost + old.out_of_turn + old.crc_errors;
      const data = hexadecimal(bus.data.bytes(k, 8).subarray(0, one.length));
      this.messages.push({ name: bus.messages[k].name, id: one.can_id, isSilent, age_s: age / 1e9,
        told: [`0x${one.can_id.toString(16).toUpperCase().padStart(3, "0")}`, bus.messages[k].name, rounded(isSilent ? 0 : rate(one, old)),
          rounded(age / 1e9), errors, isSilent | (isWrong << 1) | (!one.is_sound << 2), data] });
    }
    this.messages.sort((a, b) => a.id - b.id);
    this.byName = new Map(this.messages.map((message) => [message.name, message]));
  }

  message(name) {
    return this.byName.get(name);
  }

  hasValues(name) {
    return this.byName.has(name) && this.value(name, "alive_counter") !== null;
  }

  row(message, signal) {
    const row = this.bus.rows.get(`${message}.${signal}`);
    if (row === undefined) throw new Error(`the contract has no signal ${message}.${signal}`);
    return row;
  }

  value(message, signal) {
    const row = this.row(message, signal);
    return Number.isNaN(this.bus.latest(row)) ? null : scaled(this.bus.raw.get(row), this.bus.signals[row]);
  }

  // A value by its name in the contract, or as a number; null before it was on the bus.
  text(message, signal) {
    const value = this.value(message, signal);
    if (value === null) return null;
    const row = this.row(message, signal);
    return this.bus.signals[row].choices[this.bus.raw.get(row)] ?? value.toFixed(this.bus.signals[row].decimals);
  }

  // A message with its signals, and one of them over time; null if it was not seen.
  details(name, signal, level) {
    const { bus } = this;
    if (!this.message(name)) return null;
    const index = bus.messages.findIndex((message) => message.name === name);
    const { signals, text } = bus.messages[index];
    const bins = (one) => this.history(index, this.row(name, one), level);
    const known = signals.some((one) => one.name === signal) ? signal : null;
    const told = (one) => {
      const row = this.row(name, one.name);
      const isThere = bus.low.get(row) <= bus.high.get(row);
      const choice = isThere ? one.choices[bus.raw.get(row)] : null;
      const value = this.value(name, one.name);
      const words = choice ?? (value === null ? "-" : value.toFixed(one.decimals));
      const limits = isThere ? [scaled(bus.low.get(row), one), scaled(bus.high.get(row), one)] : [null, null];
      return [one.name, choice ? words : `${words}${["", "°", "″"].includes(one.unit) ? "" : " "}${one.unit}`, ...limits, one.unit, one.text];
    };
    const spark = (one) => bins(one.name).filter((_, k) => k % 2).map((pair) => (pair ? rounded((pair[0] + pair[1]) / 2) : null));
    return { name, text, signals: signals.map(told), sparks: signals.map(spark), signal: known, over_time: known && bins(known) };
  }

  // The smallest and largest value in each bin of time, newest last; null for a bin without frames.
  history(index, row, level) {
    const [count, ...lengths] = this.bus.facts.bins;
    const kept = this.bus.bin.get(index, level);
    const newest = Math.floor(this.now / lengths[level]);
    const found = [];
    for (let number = newest - count + 1; number <= newest; number++) {
      const place = level * count + (((number % count) + count) % count);
      const [low, high] = [this.bus.past.low.get(row, place), this.bus.past.high.get(row, place)];
      const isKept = number > kept - count && number <= kept && low <= high;
      found.push(isKept ? [scaled(low, this.bus.signals[row]), scaled(high, this.bus.signals[row])] : null);
    }
    return found;
  }
}

// Frames per second: intervals over the time from first to last frame.
function rate(one, old) {
  const intervals = one.count - old.count - (old.count ? 0 : 1);
  if (intervals === 0) return old.count ? 0 : null;
  const gone = one.last_ns - (old.count ? old.last_ns : one.first_ns);
  return gone > 0 ? (intervals / gone) * 1e9 : null;
}
