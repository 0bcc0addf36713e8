/* The hand that drags a jaw of the simulated world: it leads the jaws at its own speed.

   The page sees the jaws late, and few times a second. So the hand does not push by how far it is
   ahead, which would throw them about: it pushes against a damping of its own, by which a torque is
   a speed. What it is ahead, or behind, it takes up little by little. */

const DAMPING_NM_S_RAD = 1;
const FRICTION_NM = 0.15;
const MOST_MM_S = 110; // less than the 150 that a replay may have: so what is taught by it can be replayed
const EVERY_MS = 15;
const SPEED_OVER_MS = 40;
const TAKE_UP_S = 0.12;
const KEPT_MS = 2000;

export class Hand {
  #from;
  #mmPerRad;
  #send;
  #ways = [];
  #ahead = 0;
  #sent = 0;
  #timer;

  /* It takes the jaws at `opening`, in mm; `send` gets its torque, positive to close, and damping. */
  constructor(opening, mmPerRad, send) {
    this.#from = opening;
    this.#mmPerRad = mmPerRad;
    this.#send = send;
    this.#ways.push({ ms: performance.now(), mm: 0 });
    this.#timer = setInterval(() => this.#push(), EVERY_MS);
  }

  /* It has closed its jaw by so many mm; the other jaw goes with it. */
  move(mm) {
    const now = performance.now();
    this.#ways.push({ ms: now, mm: 2 * mm });
    while (this.#ways.length > 1 && this.#ways[1].ms < now - KEPT_MS) this.#ways.shift();
  }

  /* The jaws were open so far `age` seconds ago; null where that is not known. */
  see(opening, age) {
    if (opening === null || age === null) return;
    this.#ahead = this.#way(performance.now() - 1000 * age) - (this.#from - opening);
  }

  letGo() {
    clearInterval(this.#timer);
    this.#send(0, 0);
  }

  /* Return how far it had closed the jaws at a time. */
  #way(ms) {
    const next = this.#ways.findIndex((way) => way.ms > ms);
    if (next < 0) return this.#ways.at(-1).mm;
    if (next === 0) return this.#ways[0].mm;
    const [before, after] = [this.#ways[next - 1], this.#ways[next]];
    return before.mm + ((after.mm - before.mm) * (ms - before.ms)) / (after.ms - before.ms);
  }

  #push() {
    const now = performance.now();
    const speed = (this.#way(now) - this.#way(now - SPEED_OVER_MS)) / (SPEED_OVER_MS / 1000);
    const wanted = Math.max(-MOST_MM_S, Math.min(MOST_MM_S, speed + this.#ahead / TAKE_UP_S));
    const torque = (DAMPING_NM_S_RAD * wanted) / this.#mmPerRad + FRICTION_NM * Math.sign(wanted);
    const bounded = Math.round(torque * 100) / 100;
    if (bounded === this.#sent) return;
    this.#sent = bounded;
    this.#send(bounded, DAMPING_NM_S_RAD);
  }
}
