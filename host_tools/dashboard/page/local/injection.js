// Faults of the hardware, put into its memory as its own server of faults does.

const COLUMNS = ["kind", "target", "first_epoch", "last_epoch", "value", "period_epochs", "on_epochs"];
const FITTED = { odometer: "odometer.fitted", gnss: "gnss.fitted", gnss_position: "gnss.fitted" };
const figures = (value) => (Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(6))));

export class Refused extends Error {}

export class Injection {
  constructor(machine) {
    this.machine = machine;
    this.facts = machine.facts.faults;
    const of = (path) => machine.field("plant", path);
    this.columns = Object.fromEntries(COLUMNS.map((name) => [name, of(`faults.${name}`)]));
    [this.count, this.changesAt] = [of("faults.count"), of("faults.changes_at")];
    this.period_s = of("period_ns").get() / 1e9;
    this.of = of;
    this.names = Object.fromEntries(Object.entries(this.facts.kinds).map(([name, { number }]) => [number, name]));
  }

  epochs(seconds) {
    return Math.max(1, Math.round(seconds / this.period_s));
  }

  rows() {
    return Array.from({ length: this.count.get() }, (_, k) => Object.fromEntries(COLUMNS.map((name) => [name, this.columns[name].get(k)])));
  }

  // Active faults as the page shows them.
  active() {
    const { epoch } = this.machine;
    return this.rows().filter((row) => row.first_epoch <= epoch && epoch <= row.last_epoch).map((row) => {
      const keys = this.keys(row);
      return { words: words(keys), at_s: row.first_epoch * this.period_s, keys };
    });
  }

  keys(row) {
    const kind = this.names[row.kind];
    const { target, parameter } = this.facts.kinds[kind];
    const keys = { kind };
    if (target?.names.length) keys[target.key] = target.names[row.target];
    else if (target && row.target !== this.facts.every) keys[target.key] = row.target + 1;
    if (parameter) keys[parameter.key] = Number((row.value / parameter.si).toPrecision(9));
    if (row.period_epochs) Object.assign(keys, { period_s: row.period_epochs * this.period_s, duty: row.on_epochs / row.period_epochs });
    return keys;
  }

  // Inject a fault, given by the keys of a scenario; return its words and the time of its effect.
  inject(keys) {
    const { kind, target } = this.meant(keys);
    const { number, parameter } = this.facts.kinds[kind];
    const { epoch } = this.machine;
    const rows = this.rows().filter((row) => row.last_epoch >= epoch);
    for (const row of rows) if (row.kind === number && row.target === target && row.first_epoch <= epoch) row.last_epoch = epoch - 1;
    const kept = rows.filter((row) => row.last_epoch >= epoch);
    if (kept.length === this.facts.capacity) throw new Refused(`${words(keys)}: no room for another fault; remove one first`);
    const value = parameter ? (keys[parameter.key] ?? this.form(kind, parameter.key).default) * parameter.si : 0;
    const period = keys.period_s ? Math.max(2, Math.round(keys.period_s / this.period_s)) : 0;
    const on = period ? Math.min(period - 1, Math.max(1, Math.round((keys.duty ?? 0.5) * period))) : 0;
    const last = keys.for_s ? epoch + this.epochs(keys.for_s) - 1 : BigInt(this.facts.never) - 1n;
    const row = { kind: number, target, first_epoch: epoch, last_epoch: last, value, period_epochs: period, on_epochs: on };
    this.write([...kept, row]);
    return [words(this.keys({ ...row, last_epoch: 0 })), epoch * this.period_s];
  }

  remove(keys) {
    const { kind, target } = this.meant(keys);
    const { number } = this.facts.kinds[kind];
    if (!this.end((row) => row.kind === number && row.target === target)) throw new Refused(`${words(keys)}: is not active`);
    return words({ kind, ...Object.fromEntries(Object.entries(keys).filter(([key]) => key === this.facts.kinds[kind].target?.key)) });
  }

  // End the faults that are meant; return how many there were.
  end(isMeant = () => true) {
    const { epoch } = this.machine;
    const ended = this.rows().map((row, k) => k).filter((k) => this.columns.last_epoch.get(k) >= epoch && isMeant(this.rows()[k]));
    for (const k of ended) this.columns.last_epoch.set(epoch - 1, k);
    this.changesAt.set(0);
    return ended.length;
  }

  write(rows) {
    rows.forEach((row, k) => COLUMNS.forEach((name) => this.columns[name].set(row[name], k)));
    this.count.set(rows.length);
    this.changesAt.set(0);
  }

  form(kind, key) {
    return this.machine.facts.hello.forms[kind].fields.find((field) => field.key === key);
  }

  // The kind and the target; refuses keys that its form has not, and values beyond its limits.
  meant(keys) {
    const { kind } = keys;
    const known = this.facts.kinds[kind];
    if (!known) throw new Refused(`${kind}: is not a fault of the hardware`);
    for (const [key, value] of Object.entries(keys)) {
      const form = key === "kind" ? null : this.form(kind, key);
      if (form === undefined) throw new Refused(`${key}: does not apply to ${kind}`);
      if (value < form?.minimum || value > form?.maximum) throw new Refused(`${key}: from ${form.minimum} to ${form.maximum}`);
    }
    const { key, names } = known.target ?? {};
    const given = key && (keys[key] ?? this.form(kind, key).default);
    const target = given == null ? this.facts.every : names.length ? names.indexOf(given) : given - 1;
    const sensors = { gyro: "gyros.count", accelerometer: "accelerometers.count" }[known.part];
    const isThere = sensors ? target < this.of(sensors).get() : !FITTED[known.part] || this.of(FITTED[known.part]).get();
    if (!isThere || (names?.length && target < 0)) throw new Refused(`${words(keys)}: the hardware has no such axis, sensor or receiver`);
    return { kind, target };
  }
}

// A fault's keys in words, its kind first.
function words({ kind, ...rest }) {
  const told = Object.entries(rest).map(([key, value]) => `${key} ${typeof value === "number" ? figures(value) : value}`);
  return told.length ? `${kind} (${told.join(", ")})` : kind;
}
