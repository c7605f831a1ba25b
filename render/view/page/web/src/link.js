// The WebSocket to the server that served this page: requests as JSON, each answered by a message of JSON and arrays.

import { decode } from "./decode.js";

export class Link {
  constructor(show, ended = "The viewer has ended: start palpate view again, and open its new address.") {
    const address = new URL(location.href);
    address.protocol = "ws:";
    address.hash = "";
    this.waiting = [];
    this.ended = ended;
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = ({ data }) => this.take(data);
    this.socket.onclose = () => {
      for (const { refuse } of this.waiting.splice(0)) refuse(new Error(this.ended));
      show(this.ended, true);
    };
    this.opened = new Promise((done) => (this.socket.onopen = done));
  }

  // The answer to a request; answers come in the order of their requests.
  ask(request, onProgress = () => {}) {
    return new Promise((done, refuse) => {
      if (this.socket.readyState !== WebSocket.OPEN) return refuse(new Error(this.ended));
      this.waiting.push({ done, refuse, onProgress });
      this.socket.send(JSON.stringify(request));
    });
  }

  take(data) {
    const size = new DataView(data).getUint32(0, true);
    const described = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size)));
    const answer = decode(described, data.slice(4 + size));
    if (answer.kind === "progress") return this.waiting[0].onProgress(answer);
    const { done, refuse } = this.waiting.shift();
    if (answer.kind === "failure") refuse(new Error(answer.text));
    else done(answer);
  }
}
