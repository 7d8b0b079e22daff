// The rehearsal as WebAssembly: its memories, and fields of their records by name.

const READ = { b1: "getUint8", u1: "getUint8", u2: "getUint16", i2: "getInt16", u4: "getUint32", i8: "getBigInt64", u8: "getBigUint64", f8: "getFloat64" };
const PAGE = 65536;

const fetched = async (name) => {
  const answer = await fetch(new URL(name, import.meta.url));
  if (!answer.ok) throw new Error(`${name}: ${answer.status} ${answer.statusText}`);
  return answer;
};

export const facts = async () => (await fetched("facts.json")).json();

async function unpacked(name) {
  const stream = (await fetched(name)).body.pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export class Machine {
  static async load(facts, scenario) {
    const [code, start, bus] = await Promise.all([
      fetched(scenario.code).then((answer) => answer.arrayBuffer()).then((bytes) => WebAssembly.instantiate(bytes)),
      unpacked(scenario.image), unpacked("bus.image")]);
    return new Machine(facts, scenario, code.instance.exports, start, bus);
  }

  constructor(facts, scenario, code, start, bus) {
    Object.assign(this, { facts, scenario, code, start, bus });
    const { layouts } = facts;
    const sizes = {
      ram: scenario.ram_bytes, plant: layouts.plant.size, motion: scenario.motion_bytes, session: layouts.session.size,
      contract: facts.contract_bytes, tally: layouts.tally.size,
      truths: facts.truths * layouts.truth.size, up: facts.outboxes[0], down: facts.outboxes[1],
    };
    this.place = {};
    let end = code.__heap_base.value;
    for (const [name, size] of Object.entries(sizes)) {
      this.place[name] = end = (end + 15) & ~15;
      end += size;
    }
    this.sizes = sizes;
    code.memory.grow(Math.max(0, Math.ceil((end - code.memory.buffer.byteLength) / PAGE)));
    this.view = new DataView(code.memory.buffer);
    this.switchOn();
  }

  // Write the memories at power-on.
  switchOn() {
    const memory = new Uint8Array(this.code.memory.buffer);
    memory.fill(0, this.place.ram);
    for (const [names, image] of [[["ram", "plant", "motion", "session"], this.start], [["contract", "tally"], this.bus]]) {
      let at = 0;
      for (const name of names) {
        memory.set(image.subarray(at, at + this.sizes[name]), this.place[name]);
        at += this.sizes[name];
      }
    }
    this.epoch = 0;
  }

  // Run epochs of both sides.
  run(epochs) {
    const { plant, motion, ram, contract, tally, truths, session, up, down } = this.place;
    this.epoch = this.code.rrins_rehearse(plant, motion, this.scenario.pieces, ram, contract, tally, truths, session, up, down, epochs);
  }

  // Return what reads a field of a record, such as "load.busy_ns" of the tally: by the index of the
  // record in an array on the way, if there is one, then by that of the value.
  field(name, path) {
    let layout = this.facts.layouts[name];
    let [at, step, one] = [this.place[name === "truth" ? "truths" : name], 0, null];
    if (name === "truth") step = layout.size;
    for (const part of path.split(".")) {
      one = layout.fields[part];
      at += one.at;
      if (one.is && one.shape) step = one.size;
      layout = one.is;
    }
    return new Field(this.view, at, step, one);
  }
}

class Field {
  constructor(view, at, step, { kind, size }) {
    Object.assign(this, { view, at, step, size, kind });
    this.reading = READ[kind];
    this.writing = this.reading.replace("get", "set");
  }

  place(index) {
    return this.at + index * (this.step || this.size);
  }

  // As a number; `more` values further on, where each record has an array.
  get(index = 0, more = 0) {
    return Number(this.view[this.reading](this.place(index) + more * this.size, true));
  }

  // Its lowest 32 bits.
  word(index) {
    return this.view.getInt32(this.place(index), true);
  }

  set(value, index = 0) {
    this.view[this.writing](this.place(index), this.kind.endsWith("8") && this.kind !== "f8" ? BigInt(value) : value, true);
  }

  bytes(index, length) {
    return new Uint8Array(this.view.buffer, this.place(index), length);
  }
}
