// A feed without a server: a worker that rehearses takes the place of the socket.
// The worker is started when this is loaded, which is before the rest of the page.

const url = document.documentElement.dataset.local;
export const isLocal = Boolean(url);

const heard = []; // before anybody listens
const worker = isLocal ? new Worker(url, { type: "module", name: new URLSearchParams(location.search).get("scenario") ?? "" }) : null;
let hear = (data) => heard.push(data);
if (worker) {
  worker.onmessage = ({ data }) => hear(data);
  worker.onerror = ({ message }) => hear(JSON.stringify({ kind: "status", phase: "failed", words: message || "the rehearsal cannot be loaded" }));
}

export class LocalSocket {
  constructor() {
    this.readyState = WebSocket.OPEN;
    setTimeout(() => {
      this.onopen();
      hear = (data) => this.onmessage({ data });
      heard.splice(0).forEach(hear);
    });
  }

  send(text) {
    worker.postMessage(text);
  }
}
