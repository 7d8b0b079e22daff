// Rows of quantities as the plots need them: signals of the bus, and errors against the truth.

const mod = (value, by) => ((value % by) + by) % by;
const radians = (degrees) => (degrees * Math.PI) / 180;
const LOAD_NS = 1e9; // over which the load is taken, at least

export class Quantities {
  constructor(machine, bus) {
    this.bus = bus;
    this.facts = machine.facts.quantities;
    this.names = machine.facts.hello.columns;
    this.held = machine.scenario.scenario.held_deg;
    this.place = Object.fromEntries(this.names.map((name, k) => [name, k]));
    this.truths = machine.facts.truths;
    const of = (path) => machine.field("truth", path);
    this.truth = Object.fromEntries(["epoch", "latitude", "longitude", "height", "velocity_n"].map((name) => [name, of(`truth.${name}`)]));
    [this.north, this.east] = [of("north_m"), of("east_m")];
    this.errors = new Array(this.facts.errors).fill(NaN);
    this.biases = new Array(2 * this.facts.gyros).fill(NaN);
    this.epoch = -1;
    this.marks = [];
    this.first = null;
  }

  row() {
    const { facts, bus, place } = this;
    const row = new Float32Array(this.names.length).fill(NaN);
    const signals = facts.signals.map((index) => bus.latest(index));
    row.set(signals);
    const found = Object.fromEntries(Object.entries(facts.needed).map(([name, index]) => [name, bus.latest(index)]));
    if (!row[place.firmware_load_percent]) row[place.firmware_load_percent] = NaN;
    for (const kind of ["gyro", "accelerometer"]) if (!row[place[`${kind}_redundant`]]) row[place[`${kind}_parity`]] = NaN;
    this.followBiases(found);
    row.set(this.biases, place.gyro_bias_1_dph);
    this.follow(found, signals[place.height_m]);
    row.set(this.errors, signals.length);
    const turn = this.held[found.position - 1];
    if (turn) row.set(turn.map((angle, k) => angle + found.cycle * this.held.at(-1)[k]), place.inner_goal_deg);
    row[place.bus_load_percent] = this.load();
    return row;
  }

  // Keep the estimate of each gyro: every message reports another one.
  followBiases({ estimated_gyro: sensor, estimated_bias_dph: bias, estimated_sigma_dph: sigma }) {
    if (sensor >= 1 && sensor <= this.facts.gyros) this.biases.splice(2 * (sensor - 1), 2, bias, sigma);
  }

  // Compute errors and places of a new output; both halves must be of the same epoch.
  follow(found, height) {
    const { latitude_epoch: at, sync_epoch: sync } = found;
    if (Number.isNaN(at) || at !== found.longitude_epoch || Number.isNaN(sync)) return;
    const epoch = mod(sync - mod(sync - at, this.facts.nav_epochs), this.facts.epochs);
    const k = epoch % this.truths;
    if (epoch === this.epoch || this.truth.epoch.get(k) !== epoch) return;
    this.epoch = epoch;
    const true_ = { latitude: this.truth.latitude.get(k), longitude: this.truth.longitude.get(k), height: this.truth.height.get(k) };
    const [north, east] = [this.north.get(k), this.east.get(k)];
    this.first ??= { ...true_, north, east };
    const turned = (angle) => mod(angle + Math.PI, 2 * Math.PI) - Math.PI;
    const error = [turned(radians(found.longitude_deg) - true_.longitude) * east, (radians(found.latitude_deg) - true_.latitude) * north];
    const moved = [turned(true_.longitude - this.first.longitude) * this.first.east, (true_.latitude - this.first.latitude) * this.first.north];
    const velocity = ["east", "north", "up"].map((way, i) => found[`velocity_${way}`] - this.truth.velocity_n.get(k, i));
    this.errors = [...error, height - true_.height, ...velocity, moved[0] + error[0], moved[1] + error[1], ...moved];
  }

  // How busy the wire was in about the last second of bus time, %.
  load() {
    const [now, busy] = [this.bus.now.get(), this.bus.busy.get()];
    this.marks.push([now, busy]);
    while (this.marks.length > 2 && now - this.marks[1][0] >= LOAD_NS) this.marks.shift();
    const gone = now - this.marks[0][0];
    return gone ? (100 * (busy - this.marks[0][1])) / gone : NaN;
  }
}
