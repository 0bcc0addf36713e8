/* STOP: said at once, and said again with what came of it; whoever presses it is never left to guess. */

const CONFIRMED_WITHIN_MS = 500;
const CUT = "Cut the motor's power.";

export class Stop {
  /* `panels` are stopped together; what came of it is shown in each of `places`. */
  #panels;
  #places;
  #count = 0;

  constructor(panels, places) {
    this.#panels = panels;
    this.#places = places;
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
      else if (open.size === 0) tell("Stopped. Nothing moves until it is cleared.", "done");
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

  #tell(text, kind) {
    for (const place of this.#places) {
      place.textContent = text;
      place.dataset.stop = kind;
    }
  }
}
