/* What acts on a gripper: only with control, which is a lease that lives while the page is seen. */

import { ask } from "./ask.js";
import { deafen } from "./dialog.js";
import { numberIn, typed } from "./fields.js";
import { figure, holder, inPageWords, isNumber, outcome, owner } from "./format.js";
import { REPLAY_SPEEDS } from "./motions.js";
import { askZero } from "./zero.js";

const TTL_S = 3;
const RENEW_EVERY_MS = 1000;
const CONTINUOUS_N = 20; // the vendor's recommendation
const NEAR_MM = 1; // what the keys chose stays: steps of them add up
const GREY = "button:disabled, [type=range]:disabled";
const MOVES = ["enable", "open", "close", "hold", "release", "grasp", "set-force", "zero", "teach", "play"];
const SCROLLS = new Set(["Home", "End", "PageUp", "PageDown"]); // all the way, on a slider that a click has focused
const TRAJECTORY_NAME = /^(?![.\s])[^/\\\p{C}]{1,64}(?<!\s)$/u;

/* By the reason of a refusal, whether a state shows that it is over. */
const OVER = {
  not_enabled: ({ enabled }) => enabled,
  motor_fault: ({ mode }) => mode !== "fault",
  motor_silent: ({ mode }) => mode !== "offline",
  not_calibrated: ({ calibrated }) => calibrated,
  busy: ({ job }) => job === null,
  sent_before_stop: ({ stop }) => stop === null,
};
const CUT_OFF = new Set(["no_daemon", "connection_lost"]);
const CUT = "the connection was cut before it was answered: look where the jaws are";

/* What bars an act that needs this, the worst first. */
const BARS = {
  take: [],
  control: [],
  enable: ["late", "silent", "stop"],
  zero: ["late", "silent", "stop", "teach"],
  release: ["silent", "off"], // a finger may be in it, behind a stop, too
  hold: ["silent", "stop", "off"],
  motion: ["late", "silent", "stop", "off", "teach"],
  teach: ["late", "silent", "stop", "off", "moves"],
  force: ["late", "silent", "stop", "off", "teach", "loose"],
};
const NEEDS = { enable: "enable", zero: "zero", release: "release", hold: "hold", "clear-fault": "control", "set-force": "force", teach: "teach" }; // all else "motion"
/* What the bar says already of these reasons, by the kind of the event. */
const ABOUT = { motor_fault: "motor", motor_silent: "bus" };
const LEASE = { ttl_s: TTL_S, purpose: "the page in a browser", on_lost: "hold" };

/* How control was lost, and by whom. */
function lossOfControl({ message, data: { cause, by, why } }) {
  if (cause === "expired") return "You no longer have control: the page was hidden or cut off, or the daemon stood still";
  if (cause !== "taken" || !by) return `You no longer have control: ${message}`;
  const who = by.program === "litegripd-web" ? "Another page" : by.program;
  return `${who} took control${why ? `: ${why}` : ""}`;
}

/* What a job does that moves the jaws. */
function inMotion({ kind }) {
  if (kind === "record") return "it teaches: the jaws are slack";
  return kind === "play" ? "it replays a motion" : `it moves the jaws (${kind})`;
}

/* Whether nothing is gripped, nor about to be: jaws that are given a force close then until something resists. */
function isLoose({ is_grasped: isGrasped, force_set_n: force, job }) {
  return isGrasped === false && force === null && job?.kind !== "grasp";
}

/* Why something was refused, in the words of the buttons that there are then. */
function refusal({ message, reason, data }) {
  if (reason !== "lease_held" || !data.owner) return message;
  return `${owner(data.owner)} has the gripper: wait for it, or press “Take it over”`;
}

export class Control {
  #panel;
  #operates = false;
  #has = false;
  #isDragging = false;
  #isPressed = false; // the slider, which is not let go yet
  #isScrolling = false; // by a finger that has begun on the slider
  #isChosen = false; // the slider's value, by a person
  #slides = 0; // motions of the slider that run
  #isDisabling = false; // which ends a motion that this page has begun
  #isHolding = false;
  #isHoldKnown = true;
  #bars = {}; // what bars what, by its name in BARS
  #isRenewing = false;
  #isGiven = false; // control, back, by a person
  #owner = null; // another program that has control
  #isTakingOver = false; // which is asked about
  #mayReplace = null;
  #recording = null; // "on", "ending", or "ended" by itself; null without one
  #job = null;
  #unkept = null; // what the daemon tells of one that has ended
  #isAsking = false;
  #isAtRecording = false; // what begins or ends one is under way
  #names = [];

  constructor(panel) {
    this.#panel = panel;
    const on = (name, act) => {
      panel.node(name).onclick = act;
    };
    on("take", () => this.#take("lease.acquire", LEASE));
    on("take-over", async () => {
      if (await this.#mayTakeOver()) await this.#take("lease.take", { ...LEASE, why: "taken over on the page" });
    });
    on("give", () => this.#give());
    on("clear", () => this.#do("clear the stop", "stop.clear"));
    on("enable", () => this.#do("enable", "motor.enable"));
    on("disable", async () => {
      this.#isDisabling = true;
      const wasHeld = panel.state?.is_grasped;
      const done = await this.#do("disable", "motor.disable");
      if (done !== null && wasHeld) panel.tell("disable: done, what was held was let go");
      this.#isDisabling = false;
    });
    on("clear-fault", () => this.#do("clear the fault", "motor.clear_fault"));
    const pace = { speed_mm_s: "pace" }; // the daemon's default without one
    on("open", () => this.#with(pace, (params) => this.#move("open", "motion.open", params)));
    on("close", () => this.#with(pace, (params) => this.#move("close", "motion.close", params)));
    on("hold", () => this.#move("hold", "motion.hold"));
    on("release", async () => {
      // Behind a stop nothing moves, but what is stopped may be slack.
      const isStopped = panel.state?.stop !== null;
      const slack = () => this.#do("let go", "stop", { level: "relax", why: "“Let go” on the page" });
      const done = isStopped ? slack() : this.#move("let go", "motion.zero_gravity");
      if (await done) this.#panel.forgive("motion"); // which may have advised it
    });
    on("grasp", () =>
      this.#with({ force_n: "force", ...pace }, (params) =>
        this.#move("grasp", "motion.grasp", { until: "verdict", ...params })));
    on("set-force", () =>
      this.#with({ force_n: "force" }, (params) => this.#do("set force", "motion.set_force", params)));
    on("zero", () => askZero(this.#panel));
    on("rescale", () => askZero(this.#panel));
    for (const name of ["force", "pace", "name", "speed"]) this.#keepTyped(name);
    panel.node("force").addEventListener("input", () => this.#showForce());
    panel.node("name").addEventListener("focus", () => this.#offerNames());
    panel.node("name").addEventListener("input", ({ detail }) => {
      if (detail !== "taken") this.#offerNames(panel.node("name").value);
      for (const about of ["name", "replay"]) this.#panel.forgive(about);
    });
    const speed = panel.node("speed");
    [speed.min, speed.max] = REPLAY_SPEEDS;
    on("teach", () => this.#once(() => this.#teach()));
    on("keep", () => this.#once(() => this.#keep()));
    on("discard", () => this.#once(() => this.#discard()));
    on("play", () => this.#play());
    const slider = panel.node("slider");
    slider.oninput = () => {
      this.#isDragging = this.#isChosen = true;
      this.showTarget();
    };
    slider.onpointerup = slider.onblur = () => {
      this.#isDragging = false; // back at its place it has not changed
    };
    slider.onpointerdown = () => {
      this.#isPressed = true;
      this.#isScrolling = false;
    };
    for (const kind of ["pointerup", "pointercancel"]) addEventListener(kind, () => (this.#isPressed = false), true);
    slider.onkeydown = ({ key }) => {
      this.#isScrolling = false;
      return !SCROLLS.has(key);
    };
    slider.onpointercancel = () => {
      this.#isScrolling = true;
      this.#isDragging = this.#isChosen = false;
    };
    slider.onchange = async () => {
      this.#isDragging = false;
      if (this.#isScrolling) return void (slider.value = panel.state?.opening_mm ?? slider.value);
      // It turned grey, or lost the focus: what was dragged is left where nobody has let it go.
      if (this.#isPressed) {
        this.#isChosen = false;
        return this.#panel.tell("move: not done, the slider was not let go: drag it again");
      }
      this.#slides += 1;
      await this.#with(pace, (params) =>
        this.#move("move", "motion.move", { opening_mm: Number(slider.value), ...params }));
      this.#slides -= 1;
    };
    panel.article.addEventListener("click", (event) => this.#explain(event));
    setInterval(() => this.#renew(), RENEW_EVERY_MS);
  }

  get has() {
    return this.#has;
  }

  get isRecording() {
    return this.#recording === "on";
  }

  /* Whether the daemon has a recording of this page that is not kept yet. */
  get hasRecording() {
    return ["on", "ended"].includes(this.#recording);
  }

  /* Keep what is typed into a field over a reload: a force that was chosen for what is in the jaws is no other then. */
  #keepTyped(name) {
    const node = this.#panel.node(name);
    const kept = `${name} ${this.#panel.channel}`;
    node.value = sessionStorage.getItem(kept) ?? node.value;
    node.addEventListener("input", () => sessionStorage.setItem(kept, node.value));
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
    this.showLease(null);
    this.#showRecording(null);
    this.showTarget();
  }

  /* Press the button that a key stands for, or say why that does nothing; return whether there is one. */
  press(key) {
    const name = { e: "enable", o: "open", c: "close", g: "grasp", h: "hold" }[key];
    if (name === undefined) return false;
    const why = this.whyNot(NEEDS[name] ?? "motion");
    if (why === null) this.#panel.node(name).click();
    else this.#refuse(name, why);
    return true;
  }

  #refuse(name, why) {
    if (this.#operates && !this.#has) this.#panel.complain(`${name}: ${why}`, "lack");
    else this.#panel.tell(`${name}: ${why}`);
  }

  /* Say why what is grey does nothing: it gets no clicks, which the page below it gets in its place. */
  #explain({ target, clientX: x, clientY: y }) {
    if (target.closest("button, input")) return;
    const isThere = ({ left, right, top, bottom }) => left <= x && x < right && top <= y && y < bottom;
    const grey = [...this.#panel.article.querySelectorAll(GREY)].find((node) => isThere(node.getBoundingClientRect()));
    if (grey === undefined) return;
    const slider = this.#panel.node("slider");
    const name = grey === slider ? "move" : grey.textContent.replace(" …", "").toLowerCase();
    const other = grey === slider ? "something is held, which it would drop" : "the motor reports no fault";
    this.#refuse(name, this.whyNot(NEEDS[grey.dataset.do] ?? "motion") ?? other);
  }

  /* Why what needs one of BARS would do nothing now; null if it would do something. */
  whyNot(needs) {
    if (this.#panel.state === null) return "the gripper is not connected";
    if (!this.#operates) return "this page looks and stops only";
    if (!this.#has && needs !== "take") return `press “${this.#panel.node(this.#owner ? "take-over" : "take").textContent}” first`;
    return BARS[needs].map((name) => this.#bars[name]).find(Boolean) ?? null;
  }

  /* Do `act` with the numbers in fields, each by its parameter; an empty or a wrong one is said, and is not 0. */
  #with(fields, act) {
    const params = {};
    for (const [parameter, name] of Object.entries(fields)) {
      const node = this.#panel.node(name);
      const number = numberIn(node);
      const about = `field ${name}`;
      if (number === null) return this.#panel.complain(`${node.dataset.what}: ${node.validationMessage}`, about);
      this.#panel.forgive(about);
      if (number !== undefined) params[parameter] = number;
    }
    return act(params);
  }

  show(state) {
    const slider = this.#panel.node("slider");
    slider.max = (Math.floor(this.#panel.travel * 10) / 10).toFixed(1); // beyond the travel is refused
    const { opening_mm: opening } = state;
    const isBusy = (this.#isDragging && !slider.disabled) || this.#slides > 0;
    this.#isChosen &&= isBusy || (document.activeElement === slider && Math.abs(opening - slider.value) < NEAR_MM);
    if (opening !== null && !isBusy && !this.#isChosen) slider.value = opening;
    this.#isHolding = state.is_grasped !== false;
    this.#isHoldKnown = state.is_grasped !== null && !this.#panel.isPushedOpen;
    const { textContent: clear } = this.#panel.node("clear");
    this.#bars = {
      late: this.#lateness,
      silent: this.#panel.isSilent && "the motor does not answer",
      stop: state.stop !== null && `stopped: “${clear}” first`,
      off: !state.enabled && (state.mode === "fault" ? "a fault: “Enable” again" : "“Enable” first"),
      teach: this.#recording === "on" && `a recording runs, with a hand at the jaws: ${this.#endings} first`,
      moves: state.job !== null && "a motion runs: “Hold” ends it",
      loose: isLoose(state) && "nothing is gripped, and the jaws would close: “Grasp”",
    };
    if (this.#recording === "on" && state.job?.kind !== "record") this.#askRecording();
    this.#allow();
    this.showTarget();
    this.#panel.node("clear-fault").disabled = state.mode !== "fault";
  }

  /* Let be pressed what would do something now, and say beside the buttons why all else would not; no opening is
     chosen while something is held, which it would drop. */
  #allow() {
    const why = this.whyNot("motion");
    const lacksControl = this.whyNot("control") !== null;
    const isFree = this.#panel.state !== null && !this.#has;
    const toUse = this.#panel.node("to-use");
    const told = isFree ? "to use what is below" : why ?? "";
    if (toUse.textContent !== told) toUse.textContent = told;
    this.#panel.node("motions").disabled = lacksControl;
    for (const name of MOVES) this.#panel.node(name).disabled = this.whyNot(NEEDS[name] ?? "motion") !== null;
    this.#panel.node("slider").disabled = why !== null || this.#isHolding;
    this.#panel.node("rescale").disabled = lacksControl;
    this.#panel.dispatchEvent(new Event("allowed"));
  }

  /* Show who has the gripper; null where that is not known. */
  showLease(lease) {
    if (lease && !lease.mine) this.#renew(); // who has lost it is told why
    if (lease) this.#set(lease.mine);
    const before = this.#owner;
    this.#owner = lease?.mine ? null : lease?.owner ?? null;
    if (this.#isTakingOver && this.#owner?.number !== before?.number) this.#panel.dispatchEvent(new Event("withdrawn"));
    const isTaken = this.#owner !== null;
    if (isTaken !== (before !== null)) {
      this.#panel.forgive("lack"); // it named another button
      this.#allow();
    }
    this.#reveal("take", !this.#has && !isTaken);
    this.#reveal("take-over", isTaken);
    this.#reveal("give", this.#has);
  }

  /* Show a button in the place of another, or hide it. */
  #reveal(name, isShown) {
    const node = this.#panel.node(name);
    if (node.hidden !== isShown) return;
    node.hidden = !isShown;
    if (isShown) deafen(node);
  }

  #showForce() {
    this.#panel.node("force-note").hidden = !(typed(this.#panel.node("force")) > CONTINUOUS_N);
  }

  /* Nobody sees what moves then, and it may move much later than it was asked to. */
  get #lateness() {
    return this.#panel.isLate && "late: it would act later, unseen";
  }

  /* Show whether what is pressed may act late. */
  showLate() {
    this.#bars.late = this.#lateness;
    this.#allow();
  }

  /* Show where the slider goes to; or that something is held, which is so or was. */
  showTarget() {
    const slider = this.#panel.node("slider");
    const isOld = this.#panel.isLastKnown || !this.#isHoldKnown;
    let text = figure(this.#panel.state === null ? null : Number(slider.value), 1, "mm");
    const tellsHold = this.#isHolding && (this.#has || this.#panel.state === null);
    const isUnknown = !this.#isHoldKnown && !this.#panel.isLastKnown;
    if (tellsHold && isUnknown) text = "held or not?";
    else if (tellsHold) text = isOld ? "held, last known" : "something is held";
    this.#panel.node("slider-text").textContent = text;
    this.#panel.node("slider-text").classList.toggle("last-known", isOld && tellsHold);
    slider.setAttribute("aria-valuetext", text);
  }

  #set(has) {
    this.#has = has && this.#operates;
    this.#allow();
    this.#panel.article.classList.toggle("controlled", this.#has);
    if (!this.#has) return;
    for (const about of ["control", "lack"]) this.#panel.forgive(about);
    this.#panel.regain("control");
  }

  /* Return whether control may be taken from its owner; ask where that ends or inherits something: a motion, or a hold. */
  async #mayTakeOver() {
    const { state, channel, isLate } = this.#panel;
    if (this.#owner === null || state === null) return true; // the daemon says what is so
    const { mode, job, is_grasped: isGrasped, force_set_n: force } = state;
    const isMoving = mode === "moving";
    if (!isMoving && isGrasped === false && !isLate) return true;
    const now = [];
    if (isLate) now.push("what it does is not known");
    else {
      if (isMoving) now.push(job ? inMotion(job) : "the jaws move");
      if (isGrasped) now.push(isNumber(force) ? `it holds an object, with the force set to ${figure(force, 0, "N")}` : "it holds an object");
      if (isGrasped === null) now.push("whether it holds an object is not known");
    }
    const { program } = this.#owner;
    const what = this.#panel.whose ? "it" : channel; // the dialog names it before
    let then = "The jaws hold on, with the same force";
    if (isMoving || isLate) then = `${isLate ? "A" : "That"} motion ends then, and the jaws hold on where they are`;
    const text = `Take ${what} over from ${holder(this.#owner)}? At this moment ${now.join(", and ")}. ${then}. ${program} moves nothing more until it asks for control again.`;
    this.#isTakingOver = true;
    const isMeant = await ask(this.#panel, text, "Take it over", "take");
    this.#isTakingOver = false;
    return isMeant;
  }

  async #take(method, params) {
    this.#isGiven = false;
    try {
      await this.#call(method, params);
      this.#set(true);
      this.#panel.tell("You have control, as long as this page is seen.");
    } catch (error) {
      this.#panel.complain(`take control: ${refusal(error)}`, "control");
    }
    this.showLease({ owner: null, mine: this.#has });
    if (this.#has) await this.#isAllKept();
  }

  async #give() {
    if (!this.#has) return; // it is on its way back
    if (this.#recording === "on") {
      return this.#panel.complain(`give control back: a recording runs, and the jaws are slack: ${this.#endings} first`, "give");
    }
    this.#isGiven = true;
    this.#set(false);
    await this.#do("give control back", "lease.release");
    this.showLease({ owner: null, mine: false });
  }

  /* The buttons that end a recording. */
  get #endings() {
    return ["keep", "discard"].map((name) => `“${this.#panel.node(name).textContent}”`).join(" or ");
  }

  async #renew() {
    // Who does not see the jaws does not keep them.
    if (!this.#has || document.hidden || this.#isRenewing) return;
    this.#isRenewing = true;
    try {
      await this.#panel.wire.call("lease.renew");
    } catch (error) {
      if (CUT_OFF.has(error.reason) || error.data.followed) return; // the connection's end says it
      if (this.#isGiven) return; // back, meanwhile
      this.#set(false);
      this.#panel.loseControl(lossOfControl(error));
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
    for (const about of [name, "name"]) this.#panel.forgive(about);
    try {
      const result = await this.#call(method, params);
      const text = outcome(name, result);
      const rank = result.outcome === "object_lost" ? "loss" : "";
      if (result.ok === false) this.#panel.complain(text, "motion", undefined, rank);
      else this.#panel.tell(text);
      return result;
    } catch (error) {
      const isOffered = method === "trajectory.play" && this.#offerSpeed(name, error.data);
      if (!isOffered) this.#wrong(name, error);
      return null;
    }
  }

  /* Say why something was not done, or not to its end; a stop is said as long as it is latched, in the bar. */
  #wrong(name, error) {
    const text = `${name}: ${error.reason === "connection_lost" ? CUT : refusal(error)}`;
    if (error.reason === "lease_lost") {
      this.#set(false);
      this.#panel.loseControl(lossOfControl(error));
    } else if (error.reason === "stopped") this.#panel.tell(text);
    else if (error.reason !== "replaced") {
      const about = ABOUT[error.reason];
      const isOwn = this.#isDisabling && error.reason === "cancelled"; // said until the next motion
      this.#panel.complain(text, about ?? (isOwn ? "motion" : name), OVER[error.reason], about && "trouble");
    }
  }

  /* Return whether a trajectory may be kept under the name in the field; ask before one is replaced by `what`, which
     `needs` "motion" or "control". */
  async #mayKeep(what, needs) {
    const name = this.#panel.node("name").value;
    this.#panel.forgive("name");
    if (!TRAJECTORY_NAME.test(name)) {
      const rule = "1 to 64 characters, no / or \\, no dot at the beginning, no space at an end";
      this.#panel.complain(`“Name”: it may have ${rule}, and is “${name}”`, "name");
      return false;
    }
    if (name === this.#mayReplace) return true;
    let kept;
    try {
      const { trajectories } = await this.#panel.wire.call("trajectory.list");
      kept = trajectories.find((one) => one.name === name);
    } catch (error) {
      this.#wrong("list the trajectories", error);
      return false;
    }
    if (kept === undefined) return true;
    const text = `There is a motion of ${figure(kept.duration_s, 1, "s")} with the name “${name}” already. Replace it by ${what}?`;
    if (!(await ask(this.#panel, text, "Replace it", needs))) return false;
    this.#mayReplace = name;
    return true;
  }

  /* Do what begins or ends a recording, once: who presses twice means no more. */
  async #once(act) {
    if (this.#isAtRecording) return;
    this.#isAtRecording = true;
    try {
      await act();
    } finally {
      this.#isAtRecording = false;
    }
  }

  async #teach() {
    if (!(await this.#isAllKept())) return;
    if (!(await this.#mayKeep("a new one", "motion"))) return;
    if (this.#isHolding && !(await ask(this.#panel, "Teaching makes the jaws slack, for a hand to lead them.", "Teach", "motion"))) return;
    const begun = await this.#do("teach", "trajectory.record_start");
    if (begun === null) return this.#showRecording(null);
    this.#job = begun.job;
    this.#showRecording("on");
    this.#panel.regain("recording");
    this.#panel.tell("Recording: move the jaws by hand, then end and keep it.");
  }

  /* Return whether the daemon has no recording that nobody has kept; say what there is, and offer it, for the next one
     would take its place. It may be of a page that was closed, or of another program. */
  async #isAllKept() {
    try {
      const { unkept, kind, job } = await this.#panel.wire.call("trajectory.status");
      const isOfJob = unkept && kind === "record" && job !== null;
      const ended = isOfJob ? await this.#panel.wire.call("job.get", { job }).catch(() => null) : null;
      if (unkept) this.#tellEnd(unkept, unkept.error && inPageWords(unkept.error, unkept.terms?.error), ended?.ended_s);
      else if (this.#recording === "ended") {
        this.#showRecording(null); // another program has kept it
        this.#panel.forgive("teach");
      }
      return !unkept;
    } catch (error) {
      this.#wrong("look for a recording", error);
      return false;
    }
  }

  /* Offer an ended recording no longer than there is one: another page or program may keep or discard it. */
  async look() {
    const offered = this.#unkept;
    if (this.#recording !== "ended") return;
    let unkept;
    try {
      ({ unkept } = await this.#panel.wire.call("trajectory.status"));
    } catch {
      return; // "down" says why
    }
    if (unkept || this.#recording !== "ended" || this.#unkept !== offered) return;
    this.#showRecording(null);
    this.#panel.forgive("teach");
    this.#panel.tell("The recording is there no more: it was kept, discarded or replaced elsewhere.");
  }

  /* Say at once that a recording was broken off, and why: the jaws hold against the hand then. */
  async #askRecording() {
    if (this.#isAsking) return;
    this.#isAsking = true;
    try {
      const [{ active, error, unkept }, ended] = await Promise.all([
        this.#panel.wire.call("trajectory.status"),
        this.#panel.wire.call("job.get", { job: this.#job }),
      ]);
      if (active || this.#recording !== "on") return;
      const why = ended.error ? inPageWords(ended.error.message, ended.error.data.terms?.message) : error;
      this.#tellEnd(unkept, why, ended.ended_s);
    } catch (error) {
      this.#showRecording(null); // the daemon knows no more of it
      this.#wrong("teach", error);
    } finally {
      this.#isAsking = false;
    }
  }

  /* Say that a recording has ended at `endedS` by the daemon's clock, if that is known, and what can be done about it. */
  #tellEnd(unkept, why, endedS) {
    this.#showRecording(unkept && "ended", unkept);
    const how = why === null ? "has ended" : "was broken off";
    const left = unkept
      ? ` after ${unkept.samples} samples (${figure(unkept.duration_s, 1, "s")}), “${this.#panel.node("keep").textContent}” or “Discard”`
      : ", and there is nothing of it to keep";
    this.#panel.complain(`The recording ${how}${left}${why === null ? "" : `: ${why}`}`, "teach", undefined, undefined, endedS ?? null);
  }

  async #discard() {
    const [before, unkept] = [this.#recording, this.#unkept];
    const isOn = before === "on";
    const what = unkept ? `the recording of ${figure(unkept.duration_s, 1, "s")}` : "the recording, which goes on until you answer";
    if (!(await ask(this.#panel, `Discard ${what}? Nothing brings it back.`, "Discard it", "control"))) return;
    if (this.#recording !== before || this.#unkept !== unkept) return; // it was broken off meanwhile
    this.#showRecording(null);
    this.#panel.forgive("teach");
    if (isOn) await this.#do("end the recording", "job.cancel", { job: this.#job });
    // Kept without a name it is gone with this connection, or the next recording: nobody is offered it again.
    const dropped = await this.#do("discard", "trajectory.record_stop", { allow_empty: true, allow_partial: true });
    if (dropped !== null) this.#panel.tell("The recording is discarded.");
  }

  async #keep() {
    const [before, unkept] = [this.#recording, this.#unkept];
    const long = unkept && figure(unkept.duration_s, 1, "s");
    const isPart = unkept?.error != null;
    let what = "the new one, which goes on until you answer";
    if (unkept) what = isPart ? `the part of ${long} of a recording that was broken off` : `the new one of ${long}`;
    if (!(await this.#mayKeep(what, "control"))) return; // it is still there: another name can be given
    if (this.#recording !== before || this.#unkept !== unkept) return; // it was broken off meanwhile
    const name = this.#panel.node("name").value;
    this.#recording = "ending";
    const kept = await this.#do("keep", "trajectory.record_stop", { name, ...(isPart && { allow_partial: true }) });
    if (kept === null) {
      if (this.#recording === "ending") this.#showRecording(before, unkept);
      return;
    }
    this.#showRecording(null);
    for (const about of ["teach", "replay"]) this.#panel.forgive(about);
    if (before === "on") await this.#do("hold", "motion.hold");
    this.#panel.tell(`kept as ${kept.name}: ${figure(kept.duration_s, 1, "s")}, ${kept.samples} samples`);
    await this.#listNames();
  }

  async #play() {
    const name = this.#panel.node("name").value;
    if (this.#isHolding && !(await ask(this.#panel, "The jaws go to where that motion begins.", "Replay", "motion"))) return;
    await this.#with({ speed: "speed" }, (params) => this.#move("replay", "trajectory.play", { name, ...params }));
  }

  /* Offer the speed that goes in place of one that was too high; return whether there is one. */
  #offerSpeed(name, { field, limit }) {
    if (field !== "speed" || !(limit > 0)) return false;
    const most = Math.floor(limit * 100) / 100;
    this.#panel.node("speed").value = most;
    const text = `That replay is too fast. Speed × ${most} goes: it is in the field, press Replay again.`;
    this.#panel.complain(text, name);
    return true;
  }

  /* Offer what can be done about a recording. What was asked about one before, or granted to it, counts no more. */
  #showRecording(recording, unkept = null) {
    const [teach, keep, discard, play] = ["teach", "keep", "discard", "play"].map((name) => this.#panel.node(name));
    if (recording !== this.#recording) deafen(teach, keep, discard, play);
    this.#recording = recording;
    this.#unkept = unkept;
    if (recording !== "on") {
      this.#mayReplace = null;
      this.#panel.forgive("give");
    }
    this.#panel.dispatchEvent(new Event("withdrawn"));
    teach.hidden = recording !== null;
    keep.hidden = discard.hidden = recording === null;
    keep.textContent = unkept?.error != null ? "Keep the part" : "End and keep";
  }

  /* What takes a name into the field, which keeps the focus: so the names stay until another thing is aimed at. */
  #nameButton(name) {
    const field = this.#panel.node("name");
    const node = Object.assign(document.createElement("button"), { type: "button", textContent: name });
    node.onpointerdown = (event) => event.preventDefault();
    node.onmousedown = node.onpointerdown;
    node.onclick = () => {
      field.value = name;
      field.dispatchEvent(new CustomEvent("input", { bubbles: true, detail: "taken" })); // a second click finds the same
    };
    return node;
  }

  /* Offer the names that there are; of those what fits to the `part` that is typed, and is more than that. */
  #offerNames(part = "") {
    const fits = (name) => name !== part && name.toLowerCase().includes(part.toLowerCase());
    this.#panel.node("names").replaceChildren(...this.#names.filter(fits).map((name) => this.#nameButton(name)));
  }

  async #listNames() {
    try {
      const { trajectories } = await this.#panel.wire.call("trajectory.list");
      this.#names = trajectories.map(({ name }) => name);
      this.#offerNames();
    } catch (error) {
      if (this.#panel.state !== null) this.#wrong("list the trajectories", error);
    }
  }
}
