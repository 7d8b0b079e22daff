// Rows over time as plots need them: the whole run thinned, the last minute in full; null for NaN.

const RECENT_S = 75;
const MOST_OLD = 3000;
const THIN_EVERY = 400;

export class Store {
  constructor() {
    this.clear([]);
  }

  clear(names) {
    this.names = names;
    this.times = [];
    this.columns = names.map(() => []);
    this.place = Object.fromEntries(names.map((name, k) => [name, k]));
    this.added = 0;
    this.version = 0;
  }

  fill(times, columns) {
    this.times = Array.from(times);
    this.columns = columns.map((column) => Array.from(column, (v) => (Number.isNaN(v) ? null : v)));
    this.version++;
  }

  add(time, row) {
    if (this.times.length && time < this.times.at(-1) - 1) this.clear(this.names);
    if (this.times.length && time <= this.times.at(-1)) return;
    this.times.push(time);
    for (let k = 0; k < this.columns.length; k++) this.columns[k].push(Number.isNaN(row[k]) ? null : row[k]);
    this.version++;
    if (++this.added % THIN_EVERY === 0) this.thin();
  }

  // Keep of what is older than the last minute only as much as a plot can show.
  thin() {
    const end = this.times.at(-1);
    const step = Math.max(0.1, (end - this.times[0]) / MOST_OLD);
    const kept = [];
    let due = -Infinity;
    for (let k = 0; k < this.times.length; k++) {
      if (this.times[k] > end - RECENT_S || this.times[k] >= due) {
        kept.push(k);
        due = this.times[k] + step * 0.999;
      }
    }
    this.times = kept.map((k) => this.times[k]);
    this.columns = this.columns.map((column) => kept.map((k) => column[k]));
  }

  column(name) {
    return this.columns[this.place[name]] ?? [];
  }

  get first() {
    return this.times[0] ?? 0;
  }

  get last() {
    return this.times.at(-1) ?? 0;
  }

  // The first place at or after a time.
  at(time) {
    let low = 0;
    let high = this.times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.times[middle] < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }
}
