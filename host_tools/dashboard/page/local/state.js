// The slow part of what the page shows: vitals, sensors, troubles, the table of messages.

import { abandonedWords, driftWords } from "./events.js";

const STATUS = "FIRMWARE_STATUS";
const TABLE = "TABLE_STATUS";
const REDUNDANCY = { gyros: "GYRO_REDUNDANCY", accelerometers: "ACCELEROMETER_REDUNDANCY" };
const AXES = ["inner", "outer"];
const PATIENCE_S = 1; // of bus time, within which a sensor may still be heard
const FIRMWARE = { mode: "text", fault: "text", scheme_position: "value", scheme_cycle: "value", usable_sensors: "value", load_percent: "value", sync_lost: "value", clock_error_ppm: "value" };

export class State {
  constructor(machine) {
    this.facts = machine.facts;
    const { gyros_deg: gyros, accelerometers_deg: accelerometers } = machine.scenario.scenario;
    this.counts = { gyros: gyros.length, accelerometers: accelerometers.length };
    this.kinds = this.facts.troubles.kinds.map(([pattern, ...rest]) => [new RegExp(pattern), ...rest]);
    this.since = new Map();
  }

  told(snapshot, faults, speed) {
    const firmware = this.firmware(snapshot);
    const redundancy = Object.fromEntries(Object.keys(REDUNDANCY).map((kind) => [kind, redundancyOf(snapshot, kind)]));
    const sensors = Object.fromEntries(Object.entries(this.counts).map(([kind, count]) =>
      [kind, Array.from({ length: count }, (_, k) => this.sensor(snapshot, redundancy[kind], kind, k + 1))]));
    const troubles = [...this.troubles(snapshot, firmware, redundancy, faults)];
    return {
      speed, firmware, sensors,
      axes: Object.fromEntries(AXES.map((name) => [name, this.axis(snapshot, name)])),
      parity: Object.fromEntries(Object.entries(redundancy).map(([kind, one]) => [kind, one && [one.redundant ? one.ratio : null, one.pointsAt, one.window]])),
      troubles: this.judged(snapshot.now / 1e9, troubles),
      messages: snapshot.messages.map((message) => message.told),
    };
  }

  firmware(snapshot) {
    if (!snapshot.hasValues(STATUS)) return null;
    const values = Object.entries(FIRMWARE).map(([name, as]) => [name, snapshot[as](STATUS, name)]);
    const message = snapshot.message(STATUS);
    return { ...Object.fromEntries(values), sync_lost: Boolean(snapshot.value(STATUS, "sync_lost")), age_s: message.age_s, is_silent: message.isSilent };
  }

  axis(snapshot, name) {
    const message = `AXIS_${name.toUpperCase()}_STATUS`;
    if (!snapshot.hasValues(message)) return null;
    const state = snapshot.text(message, "state");
    if (snapshot.message(message).isSilent) return ["silent", false];
    if (state === "FAULT") return ["fault", false];
    if (snapshot.value(TABLE, `axis_${name}_abandoned`)) return ["abandoned", false];
    if (snapshot.value(STATUS, `axis_${name}_not_following`)) return ["does not follow", false];
    const source = snapshot.text(TABLE, `axis_${name}_source`);
    return source in this.facts.without_encoder ? [`encoder wrong: ${source.toLowerCase()}`, false] : [state.toLowerCase(), true];
  }

  sensor(snapshot, redundancy, kind, number) {
    const group = `SENSOR_${number}`;
    const message = snapshot.message(group);
    const status = message ? snapshot.value(group, "status") ?? 0 : 0;
    if (redundancy?.excluded.includes(number)) return "excluded";
    if (!message && snapshot.watched_s < PATIENCE_S) return "not heard";
    if (!message || message.isSilent || status & this.facts.absent_bit[kind]) return "absent";
    if (status & this.facts.saturated_bit[kind]) return "saturated";
    return redundancy?.alarm && [0, number].includes(redundancy.pointsAt) ? "suspect" : "sound";
  }

  *troubles(snapshot, firmware, redundancy, faults) {
    if (firmware?.mode === "FAULT") yield `mode FAULT: ${firmware.fault}`;
    if (snapshot.value("BRIDGING", "degraded"))
      yield `the navigation is degraded: ${(snapshot.value("BRIDGING", "recent_percent") ?? 0).toFixed(1)} % of the last 100 s bridged`;
    for (const name of AXES) {
      const message = `AXIS_${name.toUpperCase()}_STATUS`;
      if (!snapshot.hasValues(message)) continue;
      if (snapshot.value(STATUS, `axis_${name}_not_following`)) yield `the ${name} axis did not follow its command`;
      if (snapshot.text(message, "state") === "FAULT") yield `the ${name} axis reports FAULT`;
    }
    for (const name of AXES) {
      const words = this.facts.without_encoder[snapshot.text(TABLE, `axis_${name}_source`)];
      if (words) yield `the ${name} encoder contradicts the gyros: ${words}`;
      if (snapshot.value(TABLE, `axis_${name}_abandoned`)) yield abandonedWords(name);
    }
    if (snapshot.value(TABLE, "interrupted")) yield `the rotation is interrupted: ${snapshot.value(TABLE, "tries") ?? 0} tries so far, another follows`;
    const groups = snapshot.messages.filter(({ name }) => name.startsWith("SENSOR_"));
    if (firmware && firmware.usable_sensors < groups.length) yield `the firmware uses ${firmware.usable_sensors} of ${groups.length} sensor groups`;
    for (const { name, isSilent } of groups) {
      const status = snapshot.text(name, "status");
      if (status !== null && status !== "OK" && !isSilent) yield `${name} reports ${status}`;
    }
    for (const [kind, found] of Object.entries(redundancy)) if (found) yield* this.redundancyTroubles(kind, found);
    if (faults) yield `injected into the hardware by rrins: ${faults} fault${faults === 1 ? "" : "s"}`;
  }

  *redundancyTroubles(kind, found) {
    const one = kind.slice(0, -1);
    if (found.alarm) yield `the ${kind} disagree: one of them fails, and it is not known which`;
    for (const sensor of found.excluded) {
      const how = sensor === found.isolated && found.how ? `, found by ${this.facts.found_by[found.how] ?? found.how}` : "";
      yield `${one} ${sensor} is left out${how}`;
    }
    if (found.excluded.length && !found.redundant) yield `no redundancy is left among the ${kind}`;
    if (found.drift) yield driftWords(one, found.drift);
  }

  // Troubles with their severity and since when they have been there, the most severe first.
  judged(now, troubles) {
    const { order } = this.facts.troubles;
    const keys = troubles.map(keyOf);
    for (const key of this.since.keys()) if (!keys.includes(key)) this.since.delete(key);
    for (const key of keys) if (!this.since.has(key)) this.since.set(key, now);
    const told = troubles.map((text, k) => {
      const [, severity, page] = this.kinds.find(([pattern]) => pattern.test(text)) ?? [null, "warning", null];
      return { text, severity, page, since_s: this.since.get(keys[k]) };
    });
    return told.sort((a, b) => order[a.severity] - order[b.severity]);
  }
}

// What stays of a trouble's words while it lasts.
const keyOf = (text) => (text.includes("left out") ? text.split(",")[0] : text.startsWith("injected") ? text.split(":")[0] : text.replace(/(?<![A-Z_])\d+(\.\d+)?/g, "#"));

function redundancyOf(snapshot, kind) {
  const name = REDUNDANCY[kind];
  if (!snapshot.hasValues(name)) return null;
  const number = (signal) => snapshot.value(name, signal) ?? 0;
  const excluded = number("excluded");
  return {
    ratio: number("parity_ratio"), pointsAt: number("suspect"), window: 2 ** number("window_log2"), alarm: Boolean(number("alarm")),
    excluded: Array.from({ length: 16 }, (_, k) => k + 1).filter((k) => (excluded >> (k - 1)) & 1),
    isolated: number("isolated"), how: number("how") ? snapshot.text(name, "how") : null,
    redundant: Boolean(number("redundant")), drift: number("drift") ? snapshot.text(name, "drift") : null,
  };
}
