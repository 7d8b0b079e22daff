// The socket to the server: binary rows, JSON for all else; connects again when it is lost.

import { isLocal, LocalSocket } from "./local_socket.js";

const ROW = 1;
const HISTORY = 2;
const AGAIN_MS = [300, 600, 1200, 2500, 5000];

export class Feed {
  constructor(handlers) {
    this.handlers = handlers; // row, history, and one for each kind of JSON; link(isUp)
    this.attempts = 0;
    this.orders = new Map();
    this.nextId = 1;
    this.lastSequence = null;
    this.missed = 0;
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const token = location.hash.slice(1);
    const query = token ? `?token=${encodeURIComponent(token)}` : "";
    this.socket = isLocal ? new LocalSocket() : new WebSocket(`${scheme}://${location.host}/feed${query}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.attempts = 0;
      this.lastSequence = null;
      this.handlers.link(true);
    };
    this.socket.onmessage = (event) => this.take(event.data);
    this.socket.onclose = () => {
      this.handlers.link(false);
      for (const settle of this.orders.values()) settle({ is_done: false, text: "the server does not answer" });
      this.orders.clear();
      const wait = AGAIN_MS[Math.min(this.attempts++, AGAIN_MS.length - 1)];
      setTimeout(() => this.connect(), wait);
    };
  }

  take(data) {
    if (typeof data === "string") {
      const message = JSON.parse(data);
      if (message.kind === "answer") this.settle(message);
      else this.handlers[message.kind]?.(message);
      return;
    }
    const head = new DataView(data);
    const columns = head.getUint16(2, true);
    const count = head.getUint32(4, true);
    if (head.getUint8(0) === ROW) {
      if (this.lastSequence !== null && count > this.lastSequence + 1) this.missed += count - this.lastSequence - 1;
      this.lastSequence = count;
      this.handlers.row(head.getFloat64(8, true), new Float32Array(data, 16, columns));
    } else if (head.getUint8(0) === HISTORY) {
      const times = new Float64Array(data, 8, count);
      const values = [];
      for (let k = 0; k < columns; k++) values.push(new Float32Array(data, 8 + 8 * count + 4 * count * k, count));
      this.handlers.history(times, values);
    }
  }

  settle(answer) {
    this.orders.get(answer.id)?.(answer);
    this.orders.delete(answer.id);
  }

  // Give an order; the promise has the answer from the other side, `is_done` and `text`.
  order(order, more = {}) {
    return new Promise((settle) => {
      if (this.socket.readyState !== WebSocket.OPEN) {
        settle({ is_done: false, text: "the server does not answer" });
        return;
      }
      const id = this.nextId++;
      if (order !== "show") this.orders.set(id, settle);
      this.socket.send(JSON.stringify({ id, order, ...more }));
    });
  }
}
