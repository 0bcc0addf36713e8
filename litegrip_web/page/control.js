/* What acts on a gripper: only with control, which is a lease that lives while the page is seen. */

import { ask } from "./ask.js";
import { figure, outcome } from "./format.js";
import { askZero } from "./zero.js";

const TTL_S = 3;
const RENEW_EVERY_MS = 1000;
const CONTINUOUS_N = 20; // the vendor's recommendation
const MOVES = ["enable", "open", "close", "hold", "grasp", "set-force", "zero", "teach", "play"];
const LEASE = { ttl_s: TTL_S, purpose: "the page in a browser", on_lost: "hold" };

export class Control {
  #panel;
  #operates = false;
  #has = false;
  #isDragging = false;
  #isHolding = false;
  #isStopped = false;
  #isRenewing = false;
  #mayReplace = null;

  constructor(panel) {
    this.#panel = panel;
    const on = (name, act) => {
      panel.node(name).onclick = act;
    };
    on("take", () => this.#take("lease.acquire", LEASE));
    on("take-over", () => this.#take("lease.take", { ...LEASE, why: "taken over on the page" }));
    on("give", () => this.#give());
    on("clear", () => this.#do("clear the stop", "stop.clear"));
    on("enable", () => this.#do("enable", "motor.enable"));
    on("disable", () => this.#do("disable", "motor.disable"));
    on("clear-fault", () => this.#do("clear the fault", "motor.clear_fault"));
    on("open", () => this.#move("open", "motion.open", this.#pace()));
    on("close", () => this.#move("close", "motion.close", this.#pace()));
    on("hold", () => this.#do("hold", "motion.hold"));
    on("release", () => this.#move("let go", "motion.zero_gravity"));
    on("grasp", () =>
      this.#with("force", (force_n) =>
        this.#move("grasp", "motion.grasp", { force_n, until: "verdict", ...this.#pace() })));
    on("set-force", () =>
      this.#with("force", (force_n) => this.#do("set force", "motion.set_force", { force_n })));
    on("zero", () => askZero(this.#panel));
    on("rescale", () => askZero(this.#panel));
    panel.node("force").oninput = () => this.#showForce();
    on("teach", () => this.#teach());
    on("keep", () => this.#keep());
    on("play", () => this.#play());
    const slider = panel.node("slider");
    slider.oninput = () => {
      this.#isDragging = true;
      this.#showTarget();
    };
    slider.onchange = () => {
      this.#isDragging = false;
      this.#move("move", "motion.move", { opening_mm: Number(slider.value), ...this.#pace() });
    };
    setInterval(() => this.#renew(), RENEW_EVERY_MS);
  }

  get has() {
    return this.#has;
  }

  /* A connection to the daemon has begun; `ranges` are those of its configuration. */
  begin(operate, ranges) {
    this.#operates = operate;
    this.#set(false);
    const force = this.#panel.node("force");
    [force.min, force.max] = ranges.force_n;
    const pace = this.#panel.node("pace");
    [pace.min, pace.max] = ranges.speed_mm_s;
    this.#showForce();
    if (operate) this.#listNames();
  }

  /* It has ended, and the lease with it. */
  end() {
    this.#set(false);
  }

  /* Press the button that a key stands for; return whether there is one. */
  press(key) {
    const name = { e: "enable", o: "open", c: "close", g: "grasp", h: "hold" }[key];
    if (name === undefined || !this.#has) return false;
    this.#panel.node(name).click();
    return true;
  }

  /* Do `act` with the number in a field; an empty or a wrong one is said there, and is not 0. */
  #with(name, act) {
    const node = this.#panel.node(name);
    if (node.reportValidity()) return act(Number(node.value));
    this.#panel.tell(`${node.dataset.what}: ${node.validationMessage}`);
    return null;
  }

  /* The speed to move at; without one in its field, the daemon's default. */
  #pace() {
    const node = this.#panel.node("pace");
    return node.value === "" ? {} : { speed_mm_s: Number(node.value) };
  }

  show(state) {
    const slider = this.#panel.node("slider");
    slider.max = this.#panel.travel.toFixed(1);
    const isBusy = this.#isDragging || state.job !== null;
    if (!isBusy && state.opening_mm !== null && document.activeElement !== slider) {
      slider.value = state.opening_mm;
    }
    this.#isHolding = state.is_grasped !== false;
    this.#isStopped = state.stop !== null;
    this.#allow();
    this.#showTarget();
    this.#panel.node("clear-fault").disabled = state.mode !== "fault";
  }

  /* Let be pressed what would do something now: behind a stop nothing that moves, and no opening is
     chosen while something is held, which it would drop. */
  #allow() {
    this.#panel.node("motions").disabled = !this.#has;
    for (const name of MOVES) this.#panel.node(name).disabled = this.#isStopped;
    this.#panel.node("slider").disabled = !this.#has || this.#isStopped || this.#isHolding;
    this.#panel.node("rescale").disabled = !this.#has;
  }

  /* Show who has the gripper; null where that is not known. */
  showLease(lease) {
    if (lease && !lease.mine) this.#renew(); // who has lost it is told why
    if (lease) this.#set(lease.mine);
    const isTaken = Boolean(lease?.owner) && !lease.mine;
    this.#panel.node("take").hidden = this.#has || isTaken;
    this.#panel.node("take-over").hidden = !isTaken;
    this.#panel.node("give").hidden = !this.#has;
  }

  #showForce() {
    this.#panel.node("force-note").hidden = Number(this.#panel.node("force").value) <= CONTINUOUS_N;
  }

  #showTarget() {
    const slider = this.#panel.node("slider");
    const text = this.#isHolding && this.#has ? "something is held" : figure(Number(slider.value), 1, "mm");
    this.#panel.node("slider-text").textContent = text;
    slider.setAttribute("aria-valuetext", text);
  }

  #set(has) {
    this.#has = has && this.#operates;
    this.#allow();
    this.#panel.article.classList.toggle("controlled", this.#has);
    if (!this.#has) this.#showRecording(false);
  }

  async #take(method, params) {
    try {
      await this.#call(method, params);
      this.#set(true);
      this.#panel.tell("You have control, as long as this page is seen.");
    } catch (error) {
      this.#panel.complain(this.#wrong("take control", error));
    }
    this.showLease({ owner: null, mine: this.#has });
  }

  async #give() {
    this.#set(false);
    await this.#do("give control back", "lease.release");
    this.showLease({ owner: null, mine: false });
  }

  async #renew() {
    // Who does not see the jaws does not keep them.
    if (!this.#has || document.hidden || this.#isRenewing) return;
    this.#isRenewing = true;
    try {
      await this.#panel.wire.call("lease.renew");
    } catch (error) {
      this.#set(false);
      this.#panel.complain(`You no longer have control: ${error.message}`);
    } finally {
      this.#isRenewing = false;
    }
  }

  /* Call a method; what was sent before a stop that this page has not seen never runs after it. */
  #call(method, params = {}, onProgress = null) {
    const generation = this.#panel.state?.stop_generation;
    const guarded = generation === undefined ? params : { ...params, stop_generation: generation };
    return this.#panel.wire.call(method, guarded, onProgress);
  }

  /* A motion takes the place of one that this page has begun. */
  #move(name, method, params = {}) {
    return this.#do(name, method, { ...params, if_busy: "replace" });
  }

  async #do(name, method, params = {}) {
    this.#panel.tell(`${name} …`, false);
    try {
      const result = await this.#call(method, params);
      this.#panel.tell(outcome(name, result));
      return result;
    } catch (error) {
      if (error.reason !== "replaced") this.#panel.complain(this.#wrong(name, error));
      if (method === "trajectory.play") this.#offerSpeed(error.data);
      return null;
    }
  }

  /* Return whether a trajectory may be kept under the name in the field; ask before one is replaced. */
  async #mayKeep() {
    const name = this.#panel.node("name").value;
    if (name === this.#mayReplace) return true;
    try {
      const { trajectories } = await this.#panel.wire.call("trajectory.list");
      if (!trajectories.some((kept) => kept.name === name)) return true;
    } catch (error) {
      this.#panel.complain(this.#wrong("list the trajectories", error));
      return false;
    }
    const text = `There is a motion with the name “${name}” already. Replace it?`;
    if (!(await ask(text, "Replace it"))) return false;
    this.#mayReplace = name;
    return true;
  }

  #wrong(name, error) {
    return `${name}: ${error.message}`;
  }

  async #teach() {
    if (!(await this.#mayKeep())) return;
    const begun = await this.#do("teach", "trajectory.record_start");
    if (begun === null) return;
    this.#showRecording(true);
    this.#panel.tell("Recording: move the jaws by hand, then end and keep it.");
  }

  async #keep() {
    if (!(await this.#mayKeep())) return; // it is still recorded: another name can be given
    const name = this.#panel.node("name").value;
    this.#mayReplace = null;
    const kept = await this.#do("keep", "trajectory.record_stop", { name });
    if (kept === null) return;
    this.#showRecording(false);
    await this.#do("hold", "motion.hold");
    this.#panel.tell(`kept as ${kept.name}: ${figure(kept.duration_s, 1, "s")}, ${kept.samples} samples`);
    await this.#listNames();
  }

  async #play() {
    const name = this.#panel.node("name").value;
    await this.#with("speed", (speed) => this.#move("replay", "trajectory.play", { name, speed }));
  }

  /* Offer the speed that goes in place of one that was too high. */
  #offerSpeed({ field, limit }) {
    if (field !== "speed" || !(limit > 0)) return;
    const most = Math.floor(limit * 100) / 100;
    this.#panel.node("speed").value = most;
    this.#panel.complain(`That replay is too fast. Speed × ${most} goes: it is in the field, press Replay again.`);
  }

  #showRecording(isOn) {
    this.#panel.node("teach").hidden = isOn;
    this.#panel.node("keep").hidden = !isOn;
  }

  async #listNames() {
    const list = this.#panel.node("names");
    list.id = `names-${this.#panel.channel}`;
    this.#panel.node("name").setAttribute("list", list.id);
    try {
      const { trajectories } = await this.#panel.wire.call("trajectory.list");
      list.replaceChildren(...trajectories.map(({ name }) => new Option(name)));
    } catch (error) {
      this.#panel.tell(this.#wrong("list the trajectories", error));
    }
  }
}
