/* One gripper's daemon, by way of litegripd-web: a message is a line of the daemon's protocol. */

import { inPageWords } from "./format.js";

const RECONNECT_EVERY_MS = 1000;
const CLOSED = {
  4401: "The secret in this page's address is not the present one: open the address that litegripd-web printed.",
  4408: "The page was too slow to tell its secret.",
  4429: "Too many browsers show this gripper.",
};

export class RpcError extends Error {
  constructor({ message, data }) {
    super(inPageWords(message, data?.terms?.message));
    this.reason = data?.reason;
    this.hint = data?.hint;
  }
}

export class Wire extends EventTarget {
  /* Dispatches "up" ({operate}), "down" ({message}) and each notification by its method. */
  #channel;
  #token;
  #socket = null;
  #isUp = false;
  #next = 1;
  #waiting = new Map();

  constructor(channel, token) {
    super();
    this.#channel = channel;
    this.#token = token;
    this.#connect();
  }

  /* Return the result of a request; throws RpcError. `onProgress` gets its job.progress. */
  call(method, params = {}, onProgress = null) {
    const id = this.#next++;
    const request = { jsonrpc: "2.0", id, method, params };
    return new Promise((resolve, reject) => {
      if (this.#socket?.readyState !== WebSocket.OPEN) {
        reject(new RpcError({ message: "not connected", data: { reason: "no_daemon" } }));
        return;
      }
      this.#waiting.set(id, { resolve, reject, onProgress });
      this.#socket.send(JSON.stringify(request));
    });
  }

  #connect() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}/ws/${this.#channel}`);
    this.#socket = socket;
    socket.onopen = () => socket.send(JSON.stringify({ token: this.#token }));
    socket.onmessage = (message) => this.#take(JSON.parse(message.data));
    socket.onclose = (event) => {
      const why = CLOSED[event.code];
      this.#down(why ?? "litegripd-web does not answer.");
      if (event.code !== 4401) setTimeout(() => this.#connect(), RECONNECT_EVERY_MS);
    };
  }

  #take(message) {
    if (message.method === "web.welcome") {
      this.#isUp = true;
      this.#tell("up", message.params);
    } else if (message.method === "web.no_daemon") {
      this.#down(message.params.message);
    } else if (message.method === "job.progress") {
      this.#waiting.get(message.params.request)?.onProgress?.(message.params);
    } else if (message.method) {
      this.#tell(message.method, message.params);
    } else {
      this.#answer(message);
    }
  }

  #answer(message) {
    const call = this.#waiting.get(message.id);
    if (call === undefined) {
      if (message.error) this.#tell("parting", message.error);
      return;
    }
    this.#waiting.delete(message.id);
    if (message.error) call.reject(new RpcError(message.error));
    else call.resolve(message.result);
  }

  #down(message) {
    this.#isUp = false;
    const lost = { message, data: { reason: "connection_lost" } };
    for (const call of this.#waiting.values()) call.reject(new RpcError(lost));
    this.#waiting.clear();
    this.#tell("down", { message });
  }

  get isUp() {
    return this.#isUp;
  }

  #tell(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }
}
