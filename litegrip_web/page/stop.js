/* STOP: said at once, and said again with what came of it; whoever presses it is never left to guess. */

const CONFIRMED_WITHIN_MS = 500;
const EARLY_MS = 5; // as timers may be
const FRESH_MS = 4000; // before that nothing stands in the place of what came of a STOP
const CUT = "Cut the motor's power.";
const CUT_ALL = "Cut their power.";
const STOPPED = "Stopped. Nothing moves until it is cleared.";

/* Have a button act as soon as it is pressed, by any finger: a click comes only of one that is alone, and is let go where
   it was pressed. The click of the same press does nothing more; one that no pointer has made, of a key say, acts. */
export function onPress(button, act) {
  let pressing = null;
  button.onpointerdown = ({ pointerId }) => {
    pressing = pointerId;
    act();
  };
  button.onclick = ({ pointerId }) => {
    if (pointerId === undefined || pointerId !== pressing) act();
  };
}

export class Stop {
  /* `panels` are stopped together; what came of it is shown in `place`. */
  #panels;
  #place;
  #open = new Set(); // the panels that have not answered the latest STOP
  #missed = new Map(); // those that it has not reached, and why
  #pressedMs = 0;
  #toldMs = 0;
  #aging = 0;
  #tellsAll;
  #onFailed;

  /* `onFailed` is called with what has failed of a STOP, and with "" once something else is said. With `tellsAll` it says of each stop, whoever has sent it, that a silent motor does not hear of it. */
  constructor(panels, place, { tellsAll = false, onFailed = () => {} } = {}) {
    this.#panels = panels;
    this.#place = place;
    this.#tellsAll = tellsAll;
    this.#onFailed = onFailed;
    for (const panel of panels) {
      panel.addEventListener("state", () => this.#compare());
      panel.addEventListener("ended", () => {
        if (["done", "silent"].includes(this.#place.dataset.stop)) this.#say("", ""); // it may have ended, too
      });
    }
  }

  /* Stop all. */
  press() {
    const open = new Set(this.#panels);
    const missed = new Map();
    [this.#open, this.#missed, this.#pressedMs] = [open, missed, performance.now()];
    const show = () => open === this.#open && this.#show();
    this.#tell("STOP sent …", "sent");
    const timer = setTimeout(show, CONFIRMED_WITHIN_MS);
    for (const panel of this.#panels) {
      panel.miss(false);
      panel.stop().then((why) => {
        open.delete(panel);
        if (why !== null) missed.set(panel, why);
        if (open.size && why === null) return;
        if (!open.size) clearTimeout(timer);
        show();
      });
    }
  }

  #show() {
    const names = (panels) => panels.map(({ channel }) => channel).join(", ");
    const reasons = [...new Set(this.#missed.values())];
    const whose = (why) => this.#panels.filter((panel) => this.#missed.get(panel) === why);
    const missed = reasons.map((why) => `${names(whose(why))} (${why})`);
    const isDue = performance.now() - this.#pressedMs > CONFIRMED_WITHIN_MS - EARLY_MS;
    const failed = [];
    if (missed.length) failed.push(`STOP did not reach ${missed.join(", ")}`);
    if (this.#open.size && (isDue || !missed.length)) failed.push(`STOP not confirmed by ${names([...this.#open])}`);
    if (!failed.length) return this.#tell(...this.#latched());
    const isDeaf = (panel) => panel.isSilent && !this.#missed.has(panel) && !this.#open.has(panel);
    const deaf = this.#panels.filter(isDeaf);
    if (deaf.length) failed.push(`${names(deaf)} ${deaf.length > 1 ? "are" : "is"} silent`);
    const cut = failed.length > 1 || names([...this.#missed.keys(), ...this.#open]).includes(", ") ? CUT_ALL : CUT;
    this.#tell(`${failed.join("; ")}. ${cut}`, "failed");
  }

  /* What a stop that is latched for `panels` is good for, and of which kind that is: a motor that is silent does not
     hear of it. */
  #latched(panels = this.#panels) {
    const silent = panels.filter(({ isSilent }) => isSilent).map(({ channel }) => channel);
    if (!silent.length) return [STOPPED, "done"];
    let who = "the motor does";
    if (silent.length < this.#panels.length) who = `${silent.join(", ")} does`;
    else if (silent.length > 1) who = "the motors do";
    return [`Stop latched, but ${who} not answer: cut ${who.endsWith("do") ? "their" : "its"} power.`, "silent"];
  }

  /* Whether a stop is latched, by a state that was measured after what is said; null if there is none. */
  #isStopped({ state, wire }) {
    const ageS = state === null ? null : wire.age(state.monotonic_s);
    const saidS = (performance.now() - this.#toldMs) / 1000;
    return ageS === null || ageS >= saidS ? null : state.stop !== null;
  }

  /* Nothing is said any more that a state contradicts. */
  #compare() {
    const kind = this.#place.dataset.stop;
    const stopped = this.#panels.filter((panel) => this.#isStopped(panel));
    const isTold = ["done", "silent", "failed"].includes(kind);
    if (isTold && stopped.length === this.#panels.length) this.#say(...this.#latched());
    else if (kind === "failed") this.#compareMissed();
    else if (kind !== "sent" && this.#tellsAll && stopped.some(({ isSilent }) => isSilent)) {
      this.#say(...this.#latched(stopped));
    } else if (isTold && this.#panels.some((panel) => this.#isStopped(panel) === false)) this.#say("", "");
  }

  /* Whoever was not reached and answers again is stopped, by others, or is not, which is said of each. */
  #compareMissed() {
    const known = [...this.#missed.keys()].filter((panel) => this.#isStopped(panel) !== null);
    if (!known.length) return;
    const running = known.filter((panel) => !this.#isStopped(panel));
    for (const panel of known) this.#missed.delete(panel);
    if (this.#missed.size || this.#open.size) this.#show();
    else this.#say("", "");
    for (const panel of running) panel.miss(true);
  }

  #tell(text, kind) {
    this.#toldMs = performance.now();
    this.#say(text, kind);
    this.#place.dataset.fresh = "";
    clearTimeout(this.#aging);
    this.#aging = setTimeout(() => delete this.#place.dataset.fresh, FRESH_MS);
  }

  #say(text, kind) {
    if (this.#place.textContent !== text) this.#place.textContent = text;
    this.#place.dataset.stop = kind;
    this.#onFailed(kind === "failed" ? text : "");
  }
}
