/* One gripper's daemon, by way of litegripd-web: a message is a line of the daemon's protocol. */

import { inPageWords } from "./format.js";
import { newNonce } from "./proof.js";

const RECONNECT_EVERY_MS = 1000;
const CLOCK_EVERY_MS = 10_000;
const SLOW_MS = 200; // an answer that took longer makes all that is shown look late
const CLOCK_AGAIN_MS = 500;
const CLOSED = {
  4401: "The secret in this page's address is not the present one: open the address that litegripd-web printed.",
  4408: "The page was too slow to prove its secret.",
  4429: "Too many browsers show this gripper.",
};
const STRANGER =
  "What answers here does not know this page's secret, and was not told it: the address is mistyped or cut short, " +
  "or litegripd-web has a newer secret, or a stranger answers. Look whether yours runs, and open the address that " +
  "litegripd-web printed.";

export const OWN_NAME = "litegripd-web"; // as the daemon calls each page, and its stops
export const FOLLOWED = "a new daemon has taken the gripper over";
const CUT = "the connection to the daemon was cut";

export class RpcError extends Error {
  constructor({ message, data }) {
    super(data?.followed ? FOLLOWED : inPageWords(message, data?.terms?.message)); // the page connects by itself
    this.reason = data?.reason;
    this.data = data ?? {};
  }
}

export class Wire extends EventTarget {
  /* Dispatches "up" (what the bridge says first), "down" ({message, lacks}), "replaced" (another connection to a
     daemon has taken the place of the one before, at once: "up" follows) and each notification by its method. */
  #channel;
  #secret;
  #socket = null;
  #isKnown = false;
  #isUp = false;
  #next = 1;
  #waiting = new Map();
  #clock = null;
  #clockAt = 0;

  constructor(channel, secret) {
    super();
    this.#channel = channel;
    this.#secret = secret;
    this.#connect();
  }

  get isUp() {
    return this.#isUp;
  }

  /* Return the result of a request; throws RpcError. `onProgress` gets its job.progress. */
  call(method, params = {}, onProgress = null) {
    const id = this.#next++;
    const request = { jsonrpc: "2.0", id, method, params };
    if (this.#clock !== null) request.sent_s = this.#clock.webS + this.#sinceClockS; // what moves is refused if it comes late
    return new Promise((resolve, reject) => {
      if (!this.#isKnown || this.#socket.readyState !== WebSocket.OPEN) {
        reject(new RpcError({ message: "not connected", data: { reason: "no_daemon" } }));
        return;
      }
      this.#waiting.set(id, { resolve, reject, onProgress });
      this.#socket.send(JSON.stringify(request));
    });
  }

  /* Return how old, in seconds, what the daemon measured at `monotonicS` may be at most; null if unknown. */
  age(monotonicS) {
    if (this.#clock === null) return null;
    return this.#clock.monotonicS + this.#sinceClockS - monotonicS;
  }

  get #sinceClockS() {
    return (performance.now() - this.#clock.sentMs) / 1000;
  }

  /* Return `hello`, and compare the clocks of the daemon and of litegripd-web with this page's: by the quickest answer so
     far. Neither is further than what is taken for it, so nothing counts as older than it is. */
  async hello() {
    const sentMs = performance.now();
    this.#clockAt = sentMs;
    const asked = [this.call("hello", { client: OWN_NAME }), this.call("web.clock")];
    const [hello, { monotonic_s: webS }] = await Promise.all(asked);
    const tookMs = performance.now() - sentMs;
    if (this.#clock === null || tookMs <= this.#clock.tookMs) {
      this.#clock = { sentMs, tookMs, monotonicS: hello.monotonic_s, webS };
    }
    return hello;
  }

  /* Compare the clocks again, where that is due. */
  async keepClock() {
    const everyMs = this.#clock?.tookMs > SLOW_MS ? CLOCK_AGAIN_MS : CLOCK_EVERY_MS;
    if (performance.now() - this.#clockAt > everyMs) await this.hello();
  }

  #connect() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}/ws/${this.#channel}`);
    const nonce = newNonce();
    this.#socket = socket;
    socket.onopen = () => socket.send(JSON.stringify({ nonce }));
    socket.onmessage = (first) => this.#prove(socket, nonce, JSON.parse(first.data));
    socket.onclose = ({ code }) => {
      this.#isKnown = false;
      this.#down(CLOSED[code] ?? "Start litegripd-web again: with the same secret (--token-file) the page then connects by itself. It does not answer.");
      this.#connectAgain(code);
    };
  }

  #connectAgain(code) {
    if (code !== 4401) setTimeout(() => this.#connect(), RECONNECT_EVERY_MS);
  }

  async #prove(socket, nonce, { nonce: serverNonce, proof }) {
    socket.onmessage = (message) => this.#take(JSON.parse(message.data));
    if (proof === (await this.#secret.proof("server", nonce, serverNonce))) {
      socket.send(JSON.stringify({ proof: await this.#secret.proof("page", nonce, serverNonce) }));
      this.#isKnown = true;
      return;
    }
    socket.onclose = socket.onmessage = null;
    socket.close();
    this.#down(STRANGER);
    this.#connectAgain(null);
  }

  #take(message) {
    if (message.method === "web.welcome") {
      if (this.#isUp) {
        this.#cut(CUT);
        this.#tell("replaced");
      } else this.#clock = null; // it may be another machine's
      this.#isUp = true;
      this.#tell("up", message.params);
    } else if (message.method === "web.no_daemon") {
      this.#down(message.params.message, "daemon");
    } else if (message.method === "job.progress") {
      this.#waiting.get(message.params.request)?.onProgress?.(message.params);
    } else if (message.method) {
      this.#tell(message.method, message.params);
      if (message.method === "state.sample") this.#socket.send('{"method":"web.seen"}');
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

  /* `lacks` is what there is not: a connection to litegripd-web, or behind that one the daemon. */
  #down(message, lacks = "connection") {
    this.#isUp = false;
    this.#cut(message);
    this.#tell("down", { message, lacks });
  }

  /* What was asked on a connection that has ended is answered no more. */
  #cut(message) {
    const lost = { message, data: { reason: "connection_lost" } };
    for (const call of this.#waiting.values()) call.reject(new RpcError(lost));
    this.#waiting.clear();
  }

  #tell(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }
}
