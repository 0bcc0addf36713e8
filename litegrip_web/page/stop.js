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
      if (number === this.#count) this.#tell(text, kind);
    };
    tell("STOP sent …", "sent");
    const show = () => {
      const failed = [...wrong].map(([channel, why]) => `${channel} (${why})`);
      if (failed.length) tell(`STOP did not reach ${failed.join(", ")}. ${CUT}`, "failed");
      else if (open.size === 0) tell(STOPPED, "done");
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

  /* Nothing is said any more that a state contradicts, which was measured after it was said. */
  #compare() {
    const saidS = (performance.now() - this.#toldMs) / 1000;
    const is = ({ state, wire }, isStopped) => {
      const ageS = state === null ? null : wire.age(state.monotonic_s);
      return ageS !== null && ageS < saidS && (state.stop !== null) === isStopped;
    };
    if (this.#panels.some((panel) => is(panel, false))) this.#replace("done", "", "");
    if (this.#panels.every((panel) => is(panel, true))) this.#replace("failed", STOPPED, "done");
  }

  #tell(text, kind) {
    this.#toldMs = performance.now();
    this.#place.textContent = text;
    this.#place.dataset.stop = kind;
  }

  #replace(old, text, kind) {
    if (this.#place.dataset.stop !== old) return;
    this.#place.textContent = text;
    this.#place.dataset.stop = kind;
  }
}
