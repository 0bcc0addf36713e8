/* STOP: said at once, and said again with what came of it; whoever presses it is never left to guess. */

const CONFIRMED_WITHIN_MS = 500;
const CUT = "Cut the motor's power.";
const STOPPED = "Stopped. Nothing moves until it is cleared.";

export class Stop {
  /* `panels` are stopped together; what came of it is shown in `place`. */
  #panels;
  #place;
  #count = 0;
  #toldMs = 0;

  constructor(panels, place) {
    this.#panels = panels;
    this.#place = place;
    for (const panel of panels) panel.addEventListener("state", () => this.#compare());
  }

  /* Stop all. */
  press() {
    const number = ++this.#count;
    const open = new Set(this.#panels.map(({ channel }) => channel));
    const wrong = new Map();
    const tell = (text, kind) => {
      if (number !== this.#count) return;
      this.#toldMs = performance.now();
      this.#say(text, kind);
    };
    tell("STOP sent …", "sent");
    const show = () => {
      const failed = [...wrong].map(([channel, why]) => `${channel} (${why})`);
      if (failed.length) tell(`STOP did not reach ${failed.join(", ")}. ${CUT}`, "failed");
      else if (open.size === 0) tell(...this.#latched());
      else tell(`STOP not confirmed by ${[...open].join(", ")}. ${CUT}`, "failed");
    };
    const timer = setTimeout(show, CONFIRMED_WITHIN_MS);
    for (const panel of this.#panels) {
      panel.stop().then((why) => {
        open.delete(panel.channel);
        if (why !== null) wrong.set(panel.channel, why);
        if (open.size && why === null) return;
        if (!open.size) clearTimeout(timer);
        show();
      });
    }
  }

  /* What a stop that is latched is good for, and of which kind that is: a motor that is silent does not hear of it. */
  #latched() {
    const silent = this.#panels.filter(({ isSilent }) => isSilent).map(({ channel }) => channel);
    if (!silent.length) return [STOPPED, "done"];
    const whose = this.#panels.length > 1 ? ` of ${silent.join(", ")}` : "";
    return [`Stop latched, but the motor${whose} does not answer: cut its power.`, "silent"];
  }

  /* Nothing is said any more that a state contradicts, which was measured after it was said. */
  #compare() {
    const kind = this.#place.dataset.stop;
    if (!["done", "silent", "failed"].includes(kind)) return;
    const saidS = (performance.now() - this.#toldMs) / 1000;
    const is = ({ state, wire }, isStopped) => {
      const ageS = state === null ? null : wire.age(state.monotonic_s);
      return ageS !== null && ageS < saidS && (state.stop !== null) === isStopped;
    };
    if (this.#panels.every((panel) => is(panel, true))) this.#say(...this.#latched());
    else if (kind !== "failed" && this.#panels.some((panel) => is(panel, false))) this.#say("", "");
  }

  #say(text, kind) {
    if (this.#place.textContent !== text) this.#place.textContent = text;
    this.#place.dataset.stop = kind;
  }
}
