// Events in words, as the dashboard's server tells them; those of a wire cannot happen here.

import { parityWords } from "../parts.js";

const STATUS = "FIRMWARE_STATUS";
const TABLE = "TABLE_STATUS";
const KINDS = { gyro: "GYRO_REDUNDANCY", accelerometer: "ACCELEROMETER_REDUNDANCY" };
const MOST = 500;

export class Events {
  constructor(machine, bus) {
    this.bus = bus;
    this.facts = machine.facts;
    this.keys = Object.entries(this.facts.events.signals).map(([key, [message, signal]]) => [key, bus.rows.get(`${message}.${signal}`)]);
    this.now = Object.fromEntries(this.keys.map(([key]) => [key, -1]));
    this.seen = new Int32Array(this.keys.length).fill(-1); // by when each was last changed: cheap to compare
    this.events = [];
    this.untold = [];
    this.isLate = false;
  }

  add(time, text, weight) {
    const after = this.events.findIndex((event) => event[0] > time);
    const place = after < 0 ? this.events.length : after;
    this.isLate ||= place < this.events.length;
    this.events.splice(place, 0, [time, text, weight]);
    this.untold.push([time, text, weight]);
    if (this.events.length > MOST) this.events.shift();
  }

  // What is to be told to the page; null for nothing.
  told() {
    const { untold, isLate } = this;
    this.untold = [];
    this.isLate = false;
    if (!untold.length) return null;
    return { events: isLate ? this.events : untold, anew: isLate };
  }

  follow() {
    let isNew = false;
    this.keys.forEach(([, row], k) => {
      const changed = this.bus.changed.word(row);
      isNew ||= changed !== this.seen[k];
      this.seen[k] = changed;
    });
    if (!isNew) return;
    const old = this.now;
    this.old = old;
    this.now = Object.fromEntries(this.keys.map(([key, row]) => {
      const value = this.bus.latest(row);
      return [key, Number.isNaN(value) ? -1 : value];
    }));
    const time = Object.fromEntries(this.keys.map(([key, row]) => [key, this.bus.changed.get(row) / 1e9]));
    const found = [...this.changes()].map((change, k) => [time[change[0]], k, ...change.slice(1)]);
    found.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    for (const [seconds, , text, weight] of found) this.add(seconds, text, weight);
  }

  changed(key) {
    return this.now[key] >= 0 && this.now[key] !== this.old[key];
  }

  rises(key) {
    return this.now[key] > Math.max(this.old[key], 0);
  }

  falls(key) {
    return this.now[key] >= 0 && this.now[key] < this.old[key];
  }

  word(key) {
    const [message, signal] = this.facts.events.signals[key];
    return this.bus.signals[this.bus.rows.get(`${message}.${signal}`)].choices[this.now[key]] ?? String(this.now[key]);
  }

  *changes() {
    yield* this.ofMode();
    for (const [kind, message] of Object.entries(KINDS)) yield* this.ofRedundancy(kind, message);
    yield* this.ofTable();
    yield* this.ofAiding();
  }

  *ofMode() {
    const key = `${STATUS}.mode`;
    if (this.changed(key)) {
      const mode = this.word(key);
      const { modes, rotating } = this.facts.events;
      if (mode === "FAULT") yield [key, `mode FAULT: ${this.word(`${STATUS}.fault`)}`, "bad"];
      else if (mode === "NAVIGATION_STRAPDOWN" && this.old[key] === rotating) yield [key, "the rotation has stopped: navigation goes on without", "warning"];
      else if (modes[mode]) yield [key, ...modes[mode]];
    }
    const cycle = `${STATUS}.scheme_cycle`;
    if (this.rises(cycle)) yield [cycle, `cycle ${this.now[cycle]} of the scheme is complete`, "note"];
  }

  *ofRedundancy(kind, message) {
    const { now, old } = this;
    const key = (name) => `${message}.${name}`;
    const [excluded, was] = [now, old].map((one) => Math.max(0, one[key("excluded")]));
    if (this.rises(key("alarm"))) {
      const ratio = now[key("parity_ratio")];
      yield [key("alarm"), `the ${kind}s disagree${ratio > 1 ? `: parity ${parityWords(ratio)} × its threshold` : ""}`, "warning"];
    } else if (this.falls(key("alarm")) && excluded === was) yield [key("alarm"), `the ${kind}s agree again`, "good"];
    for (let sensor = 1; sensor <= 16; sensor++) {
      const bit = 1 << (sensor - 1);
      if (excluded & bit && !(was & bit)) {
        const word = this.word(key("how"));
        const how = now[key("isolated")] === sensor ? `, found by ${this.facts.found_by[word] ?? word}` : "";
        yield [key("excluded"), `${kind} ${sensor} left out${how}`, "bad"];
      } else if (was & bit && !(excluded & bit)) yield [key("excluded"), `${kind} ${sensor} is back in use`, "good"];
    }
    if (this.rises(key("repairing"))) yield [key("repairing"), "the navigation is being repaired from before the fault", "note"];
    else if (this.falls(key("repairing"))) yield [key("repairing"), "the navigation is repaired", "good"];
    const drift = key("drift");
    if (now[drift] > 0 && old[drift] <= 0) yield [drift, driftWords(kind, this.word(drift)), "warning"];
    else if (now[drift] === 0 && old[drift] > 0) yield [drift, `${kind} calibration: no drift is reported any more`, "good"];
  }

  *ofTable() {
    for (const axis of ["inner", "outer"]) {
      const lags = `${STATUS}.axis_${axis}_not_following`;
      if (this.rises(lags)) yield [lags, `the ${axis} axis does not follow its command`, "bad"];
      else if (this.falls(lags)) yield [lags, `the ${axis} axis follows again`, "good"];
      const source = `${TABLE}.axis_${axis}_source`;
      if (this.changed(source) && (this.now[source] || this.old[source] > 0)) {
        const word = this.word(source);
        yield [source, `angle of the ${axis} axis from: ${word}`, word === "ENCODER" ? "good" : "warning"];
      }
      const abandoned = `${TABLE}.axis_${axis}_abandoned`;
      if (this.rises(abandoned)) yield [abandoned, abandonedWords(axis), "bad"];
    }
  }

  *ofAiding() {
    for (const source of ["gnss", "odometer", "altimeter"]) {
      const key = `AIDING_STATUS.${source}`;
      if (!this.changed(key) || !(this.now[key] || this.old[key] > 0)) continue;
      const word = this.word(key);
      if (word !== "LOST" || this.old[key] >= 0) yield [key, `${source}: ${word.toLowerCase()}`, word === "LOST" ? "warning" : "good"];
    }
    const degraded = "BRIDGING.degraded";
    if (this.rises(degraded)) yield [degraded, "the navigation is degraded: much sensor data was bridged", "warning"];
  }
}

export const driftWords = (sensor, drift) => `${sensor} calibration drifted: ${drift.toLowerCase().replaceAll("_", " ")}, if it is one ${sensor}`;
export const abandonedWords = (axis) => `the ${axis} axis did not follow in any try: rotation abandoned`;
