/* What acts on a gripper: only with control, which is a lease that lives while the page is seen. */

import { figure, outcome } from "./format.js";
import { askZero } from "./zero.js";

const TTL_S = 3;
const RENEW_EVERY_MS = 1000;
const CONTINUOUS_N = 20; // the vendor's recommendation
const LEASE = { ttl_s: TTL_S, purpose: "the page in a browser", on_lost: "hold" };

export class Control {
  #panel;
  #operates = false;
  #has = false;
  #isDragging = false;

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
    on("open", () => this.#move("open", "motion.open"));
    on("close", () => this.#move("close", "motion.close"));
    on("hold", () => this.#do("hold", "motion.hold"));
    on("release", () => this.#move("let go", "motion.zero_gravity"));
    on("grasp", () =>
      this.#move("grasp", "motion.grasp", { force_n: this.#force, until: "verdict" }));
    on("set-force", () => this.#do("set force", "motion.set_force", { force_n: this.#force }));
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
      this.#move("move", "motion.move", { opening_mm: Number(slider.value) });
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

  show(state) {
    const slider = this.#panel.node("slider");
    slider.max = this.#panel.travel.toFixed(1);
    const isBusy = this.#isDragging || state.job !== null;
    if (!isBusy && state.opening_mm !== null && document.activeElement !== slider) {
      slider.value = state.opening_mm;
    }
    this.#showTarget();
    this.#panel.node("clear-fault").hidden = state.mode !== "fault";
    this.#panel.node("clear").disabled = false;
  }

  /* Show who has the gripper; null where that is not known. */
  showLease(lease) {
    if (lease) this.#set(lease.mine);
    const isTaken = Boolean(lease?.owner) && !lease.mine;
    this.#panel.node("take").hidden = this.#has || isTaken;
    this.#panel.node("take-over").hidden = !isTaken;
    this.#panel.node("give").hidden = !this.#has;
  }

  get #force() {
    return Number(this.#panel.node("force").value);
  }

  #showForce() {
    this.#panel.node("force-note").hidden = this.#force <= CONTINUOUS_N;
  }

  #showTarget() {
    const slider = this.#panel.node("slider");
    const text = figure(Number(slider.value), 1, "mm");
    this.#panel.node("slider-text").textContent = text;
    slider.setAttribute("aria-valuetext", text);
  }

  #set(has) {
    this.#has = has && this.#operates;
    this.#panel.node("motions").disabled = !this.#has;
    this.#panel.node("slider").disabled = !this.#has;
    this.#panel.node("rescale").disabled = !this.#has;
    this.#panel.article.classList.toggle("controlled", this.#has);
    if (!this.#has) this.#showRecording(false);
  }

  async #take(method, params) {
    try {
      await this.#call(method, params);
      this.#set(true);
      this.#panel.tell("You have control, as long as this page is seen.");
    } catch (error) {
      this.#panel.tell(this.#wrong("take control", error));
    }
    this.showLease({ owner: null, mine: this.#has });
  }

  async #give() {
    this.#set(false);
    await this.#do("give control back", "lease.release");
    this.showLease({ owner: null, mine: false });
  }

  async #renew() {
    if (!this.#has || document.hidden) return; // who does not see the jaws does not keep them
    try {
      await this.#panel.wire.call("lease.renew");
    } catch (error) {
      this.#set(false);
      this.#panel.tell(`You no longer have control: ${error.message}`);
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
    this.#panel.tell(`${name} …`);
    try {
      const result = await this.#call(method, params);
      this.#panel.tell(outcome(name, result));
      return result;
    } catch (error) {
      if (error.reason !== "replaced") this.#panel.tell(this.#wrong(name, error));
      return null;
    }
  }

  #wrong(name, error) {
    return `${name}: ${error.message}`;
  }

  async #teach() {
    const begun = await this.#do("teach", "trajectory.record_start");
    if (begun === null) return;
    this.#showRecording(true);
    this.#panel.tell("Recording: move the jaws by hand, then end and keep it.");
  }

  async #keep() {
    const name = this.#panel.node("name").value;
    const kept = await this.#do("keep", "trajectory.record_stop", { name });
    if (kept === null) return;
    this.#showRecording(false);
    await this.#do("hold", "motion.hold");
    this.#panel.tell(`kept as ${kept.name}: ${figure(kept.duration_s, 1, "s")}, ${kept.samples} samples`);
    await this.#listNames();
  }

  async #play() {
    const name = this.#panel.node("name").value;
    const speed = Number(this.#panel.node("speed").value);
    await this.#move("replay", "trajectory.play", { name, speed });
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
