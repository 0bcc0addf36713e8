/* One gripper: what is known of it, kept up to date, and shown. */

import { Control } from "./control.js";
import { Events } from "./events.js";
import { capital, figure, holder, inPageWords, isNumber, owner, STOP_WHY, time } from "./format.js";
import { Jaws } from "./jaws.js";
import { Plots } from "./plots.js";
import { onPress, Stop } from "./stop.js";
import { suspend, sweep, toast, untoast } from "./toasts.js";
import { FOLLOWED, OWN_NAME, Wire } from "./wire.js";
import { World } from "./world.js";

const HZ = 20;
const LOOK_EVERY_MS = 1000;
const AGE_EVERY_MS = 200;
const OVERTAKES = new Set(["job_started", "motor", "stop", "stop_cleared"]);
const LATE_S = 1;
const CALM_MS = 1000; // so long states have to come in time before they are called late no more
const JUST_S = 1;
const HEALTH = { ok: "Healthy", degraded: "Degraded", down: "Down" };
const HAND_OVER_MS = 1500;
const DEAD = "no daemon: what was held must be taken for let go: a motor without commands lets go by itself";
const START_IT = "Start the daemon ('litegripctl doctor' says what is wrong): the page connects by itself.";
const OLD = "Keep hands off: what is shown is old. Press STOP; if that is not confirmed, cut the motor's power.";
const LOSSES = { object_lost: "OBJECT LOST", released_by_fault: "LET GO" };
const MOVELESS = new Set(["enable", "disable", "clear_fault", "hold", "set_force", "zero_gravity", "set_zero"]);
const STILL = "still"; // with nothing between the jaws
const JOBS = { record: "teaching: jaws slack", play: "replaying" };
const GONE = {
  held: "what was held was let go",
  stop: "the stop is gone",
  recording: "the recording is lost",
  control: "you no longer have control",
};
const AGAIN = "“Enable”, “Open”, then “Grasp” again";
const MISSED = "NOT STOPPED: press STOP again. It did not get through.";
const SUPPORT = "support what is held, it may slip";
const LOWERED = `FORCE LOWERED BY HEAT: ${SUPPORT}, and set less force (“Set force”)`;
const PUSHED = "PUSHED OPEN: look whether what the jaws gripped is still between them";
const WAS_PUSHED = "The jaws were pushed open: look if what they gripped is still held";
/* The softest object that the daemon counts on gives way by 20 N·m/rad: what it springs back by when all of the force
   is taken from it is 0.37 mm/N, and no push. 5 mm is more than what a hard one and the gripper's own parts give way. */
const PUSHED_MM_PER_N = 0.4;
const PUSHED_MM = 5;
const UNSEEN =
  "No software sees what else pushes the jaws, a hand or a weight, nor a motor that makes other than it reports.";

/* What the gripper does, in the words of the page's buttons where it has any. */
function doing({ mode, job, is_grasped: isGrasped }) {
  if (job === null) return mode === "holding" && isGrasped === false ? STILL : mode;
  const { kind, phase } = job;
  const named = phase && phase !== kind ? ` (${phase})` : "";
  if (mode === "moving" && Object.hasOwn(JOBS, kind)) return `${JOBS[kind]}${named}`;
  return `${mode}: ${kind}${named}`;
}

/* A message that ends with what to do, with that first: there is no room for all of it everywhere. */
function actFirst(message, hint) {
  const end = `: ${hint}`;
  return hint && message.endsWith(end) ? `${hint}: ${message.slice(0, -end.length)}` : message;
}

/* Of the data of events that may report a trouble: the words for it, first what to do, and in which states it is so. */
const TROUBLES = {
  motor({ phase, status, error, hint, terms }) {
    if (phase !== "fault" || !status) return null;
    const act = inPageWords(hint, terms?.hint);
    const text = actFirst(inPageWords(error, terms?.error), act);
    return { text, act, isIn: (state) => state.mode === "fault" && state.status === status };
  },
  bus({ state: name, error, hint, terms, at_rest: isAtRest }) {
    if (name === "up" || isAtRest) return null;
    const why = error === null ? [] : [inPageWords(error, terms?.error)];
    const remedy = hint === null || name === "motor_silent" ? [] : [hint]; // of silence the error says it
    const bus = name === "motor_silent" ? [] : [`the CAN bus is ${name.replaceAll("_", " ")}`];
    return { text: [...remedy, ...bus, ...why].join(": "), isIn: ({ bus }) => bus === name };
  },
};

/* Where the jaws have gripped, and with which set force, by the moments of before; null if they do not hold by force. */
function gripIn(moments) {
  const began = moments.findLastIndex(({ set }) => set === null) + 1;
  const held = moments.slice(began).filter(({ opening }) => opening !== null);
  if (!held.length) return null;
  return { mm: Math.min(...held.map(({ opening }) => opening)), n: Math.max(...held.map(({ set }) => set)) };
}

/* Whether a job of this kind moves the jaws from its beginning on; a replay only loads at first, and may be refused then. */
function moves(kind) {
  return kind !== "play" && !MOVELESS.has(kind);
}

/* Whether an event begins what moves the jaws. */
function isMotion({ kind, data }) {
  return kind === "job_started" && moves(data.kind);
}

/* Whether a replay moves the jaws. */
function isReplaying({ job }) {
  return job?.kind === "play" && ![null, "load", "paused"].includes(job.phase);
}

/* What a fault let go of: first what to do about that, which is `act` if it is known, then what it was. */
function letGo({ data: { why, certain, force_n: force, width_mm: width, terms } }, act) {
  const how = certain ? "has been let go" : "must be taken for let go: without power or commands the motor lets go by itself";
  return `${actFirst(inPageWords(why, terms?.why), act)}; what was held with ${force} N, at ${figure(width, 1, "mm")}, ${how}`;
}

/* Dispatches "state" when a new one has been shown, and "alarms" when other things are wrong. */
export class Panel extends EventTarget {
  #nodes = {};
  #offsetS = 0;
  #doubt;
  #lease = null;
  #health = null;
  #lost = null; // the event of an object that was lost, or let go by nobody's wish
  #isPast = false; // what had lost it, which is no longer so
  #replay = null; // the job of a replay that has begun since, and may not have moved yet
  #toldLoss = ""; // what the bar says of it
  #readS = null;
  #seenS = null; // of a lost object whose line in the bar has been read
  #last = null; // the state when the connection ended
  #epoch = null; // which start of the daemon it was
  #pid = null; // which process
  #heldS = -Infinity; // when something was held last
  #before = null; // what was so when the connection ended
  #gone = new Map(); // what of that is no more, and has not been read
  #weak = null; // the event of a motor that is weak
  #toldWeak = ""; // what the bar says of it
  #isWeakRead = false;
  #wasLowered = false; // the force of the hold, by heat
  #grip = null; // the narrowest opening (mm) since something is held, and the greatest set force (N)
  #pushedS = null; // since when something has pushed the jaws open, which has not been read
  #troubles = new Map(); // of motor and bus, by the event's kind
  #isMissed = false; // by a STOP that was pressed on the page
  #hasLostControl = false; // which has not been read
  #isLate = false;
  #oldMs = 0; // when a state was last too old
  #away = ""; // what the bar says of why there is no newer state
  #operates = false;
  #maySend = false; // what acts, which the daemon may refuse
  #told = ""; // beside the buttons
  #isOver = false;
  #isGrasped = null;
  #toldS = 0;
  #lacks = "connection";
  #facts = new Map();
  gripper = null;
  state = null;
  isPushedOpen = false;
  alarms = [];

  constructor(channel, secret, place) {
    super();
    const article = document.getElementById("gripper").content.cloneNode(true).firstElementChild;
    article.setAttribute("aria-label", `Gripper ${channel}`);
    article.dataset.channel = channel;
    place.append(article);
    for (const node of article.querySelectorAll("[data-is], [data-do]")) {
      this.#nodes[node.dataset.is ?? node.dataset.do] = node;
    }
    this.article = article;
    this.channel = channel;
    const { clear, said } = this.#nodes;
    clear.textContent = document.body.classList.contains("several") ? `Clear ${channel}` : "Clear the stop";
    document.getElementById("clears").append(clear);
    this.#nodes.channel.textContent = channel;
    this.#nameRows();
    this.wire = new Wire(channel, secret);
    this.events = new Events(this.#nodes.events, this.wire);
    this.plots = new Plots(this.#nodes.plots, channel);
    this.world = new World(this);
    this.jaws = new Jaws(this.#nodes.jaws, this.world);
    this.control = new Control(this);
    const stop = new Stop([this], this.#nodes.outcome, { onFailed: (text) => this.#tellFailed(text) });
    onPress(this.#nodes.stop, () => stop.press());
    said.onclick = () => this.#showWhole(said.ariaExpanded === "false");
    const { wire } = this;
    wire.addEventListener("up", ({ detail }) => this.#begin(detail));
    wire.addEventListener("down", ({ detail }) => this.#end(detail));
    wire.addEventListener("replaced", () => this.#goOn());
    wire.addEventListener("state.sample", ({ detail }) => this.#show(detail.state));
    wire.addEventListener("event", ({ detail }) => this.#take(detail));
    setInterval(() => this.#look(), LOOK_EVERY_MS);
    setInterval(() => this.#showAge(), AGE_EVERY_MS);
  }

  node(name) {
    return this.#nodes[name];
  }

  /* Say whose they are beside what acts, of several grippers: their heads may be out of sight. */
  #nameRows() {
    if (!this.whose) return;
    for (const row of this.article.querySelectorAll(".slider span, .controls .row, .world .row")) {
      row.prepend(Object.assign(document.createElement("b"), { textContent: this.channel }), " ");
    }
  }

  /* Say how something ended, until something else happens; or what goes on, if it is not over. */
  tell(text, isOver = true) {
    this.#told = text;
    this.#showTold(false);
    this.#isOver = isOver;
    this.#toldS = this.wire.age(0) ?? Infinity; // by the daemon's clock, at the latest
  }

  /* Show what was told last; what was told before the page was late may be over, and is marked then. */
  #showTold(isOld) {
    const { outcome } = this.#nodes;
    const isMarked = isOld && this.#told !== "";
    outcome.textContent = isMarked ? `${this.#told.replace(/\.$/, "")}, last known` : this.#told;
    outcome.classList.toggle("last-known", isMarked);
    delete outcome.dataset.stop;
  }

  /* Say no more what was said of a connection that has ended; what came of a STOP stays. */
  #hush() {
    if (!this.#nodes.outcome.dataset.stop) this.tell("");
  }

  /* Say what is wrong `about` something, until it has been read or a state comes for which `isOver`. It is so since
     `sinceS` by the daemon's clock (null: that is not known), else since now. */
  complain(text, about, isOver, rank, sinceS) {
    this.tell(text);
    this.forgive(about);
    const since = sinceS === undefined ? {} : { atS: sinceS === null ? null : sinceS + this.#offsetS };
    toast(this.channel, text, about, { isOver, rank, ...since });
  }

  /* Say that control is lost: by a word beside STOP, too, for a loss hides the sentence. */
  loseControl(text) {
    this.#noteControl(true); // first: what is newly wrong takes away what is told
    this.tell(text);
    toast(this.channel, text, "control", { onRead: () => this.forgive("control") });
  }

  #noteControl(hasLost) {
    if (this.#hasLostControl === hasLost) return;
    this.#hasLostControl = hasLost;
    this.#showAlarms();
  }

  /* Say whether a STOP has missed this gripper, which answers again: until it is stopped, or somebody has read it. */
  miss(isMissed) {
    if (this.#isMissed === isMissed) return;
    this.#isMissed = isMissed;
    this.#showAlarms();
    const onRead = () => this.miss(false);
    if (isMissed) toast(this.channel, MISSED, "stop", { rank: "unstopped", atS: null, onRead });
    else this.forgive("stop");
  }

  /* Say in the bar, too, that a STOP of this gripper alone has failed. */
  #tellFailed(text) {
    if (text) toast(this.channel, text, "failed stop", { rank: "failed", outlives: true });
    else this.forgive("failed stop");
  }

  /* Say in the bar why there is no newer state, and what to do about that, as long as it is so. */
  #tellAway(text) {
    if (text === this.#away) return;
    this.#away = text;
    if (text) toast(this.channel, text, "away", { rank: "away", atS: null, onRead: null, outlives: true });
    else this.forgive("away");
  }

  /* Complain no more about something. */
  forgive(about) {
    untoast(this.channel, about);
    if (about === "control") this.#noteControl(false);
  }

  /* Whether what is shown is no longer measured. */
  get isLastKnown() {
    return this.state === null || Boolean(this.state.stale) || this.#isLate;
  }

  /* What the gripper does, in few words, and what came of the last act. */
  get brief() {
    const { mode, outcome } = this.#nodes;
    const told = outcome.textContent && `. ${capital(outcome.textContent)}`;
    return `${this.whose}${figure(this.state?.opening_mm, 1, "mm")}, ${mode.textContent}${told}`;
  }

  /* What begins a text that is read elsewhere than on the panel: its name, if there are several. */
  get whose() {
    return document.body.classList.contains("several") ? `${this.channel}: ` : "";
  }

  get isLate() {
    return this.#isLate;
  }

  get isSilent() {
    return this.state?.mode === "offline";
  }

  /* Stop this gripper; return null once the daemon has confirmed it, otherwise why that is not known. */
  async stop() {
    try {
      await this.wire.call("stop", { level: "hold", why: STOP_WHY });
      return null;
    } catch (error) {
      if (this.state !== null) return error.message;
      return this.#lacks === "daemon" ? "no daemon answers" : "no connection"; // the head says why, at length
    }
  }

  async #begin({ operate: mayAct, user, history }) {
    try {
      const hello = await this.wire.hello();
      this.#setRights(mayAct, hello.role, user);
      this.#offsetS = Date.now() / 1000 - hello.monotonic_s;
      this.gripper = hello.gripper;
      this.#nodes.simulated.hidden = !hello.simulated;
      const { ranges } = await this.wire.call("config.get");
      const moments = this.#moments(history);
      this.plots.begin(moments);
      this.#grip ??= gripIn(moments);
      const events = await this.wire.call("events.subscribe");
      this.events.begin(events.events, this.#offsetS, hello.epoch);
      this.#weak = null;
      for (const event of events.events) {
        this.#noteLoss(event);
        this.#noteWeak(event);
        this.#noteTrouble(event);
      }
      const { jobs } = await this.wire.call("job.list"); // older than the events that are kept
      const later = jobs.filter(({ started_s: s }) => this.#lost !== null && s > this.#lost.monotonic_s);
      if (later.some(({ kind, state }) => moves(kind) || (kind === "play" && state === "done"))) this.#moveOn();
      const states = await this.wire.call("state.subscribe", { hz: HZ });
      this.#hush();
      this.#tellAway("");
      suspend(this.channel, false);
      this.#compare(hello, states.state);
      this.#show(states.state);
      this.control.begin(this.#operates, ranges);
      this.world.begin(hello.simulated, this.#operates);
      await this.#look();
    } catch (error) {
      if (error.reason !== "connection_lost") this.tell(error.message); // its end is said already
    }
  }

  /* Show what acts only where both litegripd-web and the daemon let it act; else say who does not. */
  #setRights(mayAct, role, user) {
    this.#operates = mayAct && role !== "observer";
    this.#maySend = mayAct;
    const { "read-only": note } = this.#nodes;
    for (const node of this.article.querySelectorAll("[data-acts]")) node.hidden = !this.#operates;
    note.hidden = this.#operates;
    const why = mayAct
      ? `for the daemon, the user ${user}, who runs litegripd-web, is an observer. “[access]” in the daemon's ` +
        "configuration decides that (docs/access.md)."
      : "litegripd-web was started without --operate.";
    note.textContent = `This page looks and stops: ${why}`;
  }

  /* Whether the page may clear this stop: an observer his own, which here is that of a page. */
  #mayClear({ by }) {
    return this.#operates || (this.#maySend && by === OWN_NAME);
  }

  /* What is wrong now, the worst first; all of it is said elsewhere, too. */
  #alarm(alarms) {
    if (alarms.join() === this.alarms.join()) return;
    if (this.#isOver && alarms.some((alarm) => !this.alarms.includes(alarm))) this.#hush();
    this.alarms = alarms;
    this.dispatchEvent(new Event("alarms"));
  }

  #showAlarms() {
    if (this.state === null) return; // there is no connection, which is what is said
    const { force_set_n: force, mode, motor, status, stop } = this.state;
    const alarms = [];
    if (this.#isMissed) alarms.push("NOT STOPPED");
    if (this.#lost !== null) alarms.push(LOSSES[this.#lost.kind]);
    if (mode === "fault") alarms.push(`FAULT: ${status.replaceAll("_", " ")}`);
    if (this.isSilent) alarms.push(motor === "silent" ? "MOTOR SILENT" : "NO MOTOR");
    if (this.#isLate) alarms.push("LATE");
    if (stop !== null) alarms.push("STOPPED");
    if (this.#hasLostControl) alarms.push("CONTROL LOST");
    if (this.isPushedOpen) alarms.push("PUSHED OPEN");
    if (this.#isLowered) alarms.push("FORCE LOWERED BY HEAT");
    if (this.#isWeak) alarms.push(`WEAK MOTOR${force === null ? "" : ": makes less than was asked for"}`);
    this.#alarm(alarms);
  }

  /* What litegripd-web has kept of the last minute, as moments for the plots. */
  #moments({ fields, rows }) {
    return rows.map((row) => this.#moment(Object.fromEntries(fields.map((name, at) => [name, row[at]]))));
  }

  #moment(state) {
    return {
      time: state.monotonic_s + this.#offsetS,
      opening: state.stale ? null : state.opening_mm,
      command: this.#openingAt(state.command_rad),
      force: state.stale ? null : state.force_n,
      set: state.force_set_n,
    };
  }

  #end({ message, lacks }) {
    if (this.state !== null) {
      this.#last = this.state;
      const atS = this.state.monotonic_s;
      const before = this.#note(lacks);
      const isTaken = before.held || before.recording;
      if (lacks === "daemon" && isTaken) setTimeout(() => this.#noteDeath(before, atS), HAND_OVER_MS);
    }
    this.state = null;
    this.#lacks = lacks;
    this.#hush();
    this.#lease = this.#health = null;
    this.#nodes.mode.textContent = `no ${lacks}`;
    this.#nodes.mode.dataset.mode = "offline";
    this.#nodes.why.textContent = lacks === "daemon" ? `${START_IT} ${capital(message)}.` : message;
    suspend(this.channel, true);
    this.#tellAway(`NO ${lacks.toUpperCase()}: ${lacks === "daemon" ? START_IT : message}`);
    this.#nodes.stopped.hidden = this.#nodes.clear.hidden = this.#nodes.doubted.hidden = true;
    this.#showLoss();
    this.#sayFirst("why");
    this.#doubt = undefined;
    this.#isLate = false;
    this.article.classList.remove("late");
    this.article.classList.add("down");
    this.#showLoud();
    this.#showHeld();
    this.#showLack();
    if (this.#last !== null) this.#showJaws(this.#last);
    this.control.end();
    this.world.end();
    this.#showFacts();
    this.dispatchEvent(new Event("ended"));
  }

  /* Keep what was so when a connection ended, for what comes after it; return that. */
  #note(lacks) {
    const { monotonic_s: atS, stop } = this.state;
    const held = atS - this.#heldS < JUST_S; // a daemon that ends disables the motor first
    const { has: control, hasRecording: recording } = this.control;
    const before = this.#before ?? { control: false, recording: false };
    this.#before = {
      lacks,
      held,
      stop: stop !== null,
      recording: recording || before.recording,
      control: control || before.control,
    };
    return this.#before;
  }

  /* A daemon answers again at once where one has ended the connection: what is shown stays until its first state, or
     is late. Nothing is to be done but to take control again. */
  #goOn() {
    if (this.state === null) return; // no state has come since the connection before
    this.#note("daemon");
    this.#hush();
    this.control.end();
    this.world.end();
  }

  async #look() {
    if (!this.wire.isUp || document.hidden) return;
    const weak = this.#weak;
    try {
      [this.#health, this.#lease] = await Promise.all([
        this.wire.call("health"),
        this.wire.call("lease.get"),
        this.wire.keepClock(),
      ]);
    } catch {
      this.#health = this.#lease = null; // shown as unknown; "down" says why
    }
    // The daemon does not report the end of what another program's commands made unknown.
    if (this.#health?.verdict === "ok" && this.#weak === weak) this.#weak = null;
    this.control.showLease(this.#lease);
    this.#showFacts();
    await this.control.look();
  }

  /* The head is red while nobody knows what the jaws do that moved, or may have held something. */
  #showLoud() {
    const isAway = this.state === null || this.#isLate;
    const { mode, is_grasped: isGrasped } = this.state ?? this.#last ?? { is_grasped: false };
    this.article.classList.toggle("away-loud", isAway && (mode === "moving" || isGrasped !== false));
  }

  /* Mark what is shown as late when it is older than a second, by the daemon's own clock. */
  #showAge() {
    if (this.#last !== null && this.state === null) this.plots.advance(Date.now() / 1000);
    if (this.state === null || !this.wire.isUp) return;
    const age = this.wire.age(this.state.monotonic_s);
    const isOld = age === null || age > LATE_S;
    if (isOld) this.#oldMs = performance.now();
    const isLate = isOld || (this.#isLate && performance.now() - this.#oldMs < CALM_MS);
    if (isLate) this.plots.advance(Date.now() / 1000);
    if (!isLate && !this.#isLate) return;
    if (isLate !== this.#isLate && !this.#nodes.outcome.dataset.stop) this.#showTold(isLate);
    this.#isLate = isLate;
    this.article.classList.toggle("late", isLate);
    this.#showLoud();
    this.#tellAway(isLate ? `LATE: ${OLD}` : "");
    this.#showMode(this.state, age);
    this.#showJaws(this.state);
    this.control.showTarget();
    this.control.showLate();
    this.#showFacts();
  }

  async #take(event) {
    this.events.add(event, this.#offsetS);
    this.#noteLoss(event);
    this.#noteWeak(event);
    this.#noteTrouble(event);
    if (isMotion(event)) {
      this.forgive("motion");
      this.#grip = null; // it may grip another thing, or elsewhere
      this.#forgetPush();
    }
    if (OVERTAKES.has(event.kind) && this.#isOver && event.monotonic_s > this.#toldS) this.#hush();
    if (event.kind === "lease" || event.kind === "lease_lost") await this.#look();
    if (event.kind === "calibration") {
      this.gripper = (await this.wire.hello()).gripper;
      this.#doubt = undefined; // the next state asks why, again
    }
  }

  /* How far the jaws travel, in mm: as calibrated, otherwise as configured. */
  get travel() {
    return this.gripper.travel_mm ?? this.gripper.stroke_mm;
  }

  /* The change of the opening for a rad of the motor that opens, in mm; null without a calibration. */
  get mmPerRad() {
    const { closed_rad: closed, open_rad: open, travel_mm: travel } = this.gripper ?? {};
    if (![closed, open, travel].every(isNumber) || open === closed) return null;
    return travel / Math.abs(open - closed);
  }

  /* Return the opening in mm at a motor position; null without a calibration. */
  #openingAt(rad) {
    if (!isNumber(rad) || this.mmPerRad === null) return null;
    const { closed_rad: closed, open_rad: open } = this.gripper;
    return (rad - closed) * Math.sign(open - closed) * this.mmPerRad;
  }

  /* A lost object is said until the next motion; one that was let go, until that has been read, too. */
  #noteLoss(event) {
    const { kind, data, monotonic_s: atS } = event;
    if (kind === "job_started" && data.kind === "play") this.#replay = data.job;
    const isReplayed = kind === "job_ended" && data.job === this.#replay && data.reason === null;
    if (isMotion(event) || isReplayed) {
      this.#moveOn();
    } else if (kind in LOSSES && atS !== this.#readS) {
      this.#lose(event);
    } else if (kind === "job_started" && data.kind === "disable" && this.state?.is_grasped && !this.control.has) {
      const by = event.message.replace(/^.* by /, "");
      this.#lose({ kind: "released_by_fault", monotonic_s: atS, message: `what was held was let go: disabled by ${by}` });
    }
  }

  /* The jaws are moved: what was lost before is said no more. */
  #moveOn() {
    this.#replay = null;
    this.#forget();
    this.#lose(null);
  }

  #lose(lost) {
    this.#lost = lost;
    if (lost !== null) this.#replay = null; // that one may have lost it
    this.#isPast = false;
    this.#toldLoss = "";
    this.forgive("let go");
    if (lost?.kind === "released_by_fault") for (const kind of Object.keys(TROUBLES)) this.forgive(kind);
    this.#showLoss();
    this.#showAlarms();
  }

  /* Take what a daemon held for let go: it is away for longer than a hand-over takes. */
  #noteDeath(before, atS) {
    if (this.#before !== before) return;
    if (before.recording) {
      this.forgive("teach");
      toast(this.channel, capital(`${GONE.recording}: the daemon has ended.`), "recording", { outlives: true });
    }
    if (!before.held || this.#lost !== null) return;
    this.#lose({ kind: "released_by_fault", monotonic_s: atS, message: DEAD, data: {}, isDead: true });
    this.#showLack();
  }

  #showLack() {
    this.#alarm([...(this.#lost === null ? [] : [LOSSES[this.#lost.kind]]), `NO ${this.#lacks.toUpperCase()}`]);
  }

  /* Say what is gone that was before the connection ended: with another daemon all of it, otherwise the control. */
  #compare({ epoch, pid }, { is_grasped: isGrasped, stop, monotonic_s: atS }) {
    const [isNew, isFollowed, before] = [epoch !== this.#epoch, pid !== this.#pid, this.#before];
    [this.#epoch, this.#pid, this.#before, this.#heldS] = [epoch, pid, null, -Infinity];
    if (this.#lost !== null && (isGrasped || this.#lost.isDead)) this.#lose(null);
    if (before === null) return;
    const where = before.lacks === "daemon" ? "the daemon" : "litegripd-web";
    let why = `the connection to ${where} was cut`;
    if (isNew) why = "the daemon was restarted";
    else if (isFollowed) why = FOLLOWED;
    const isGone = {
      held: isNew && before.held && !isGrasped,
      stop: isNew && before.stop && stop === null,
      recording: isNew && before.recording,
      control: before.control,
    };
    if (isGone.recording) this.forgive("teach"); // nothing is left of it to keep
    this.forgive("recording"); // which is said with all else, or was there all the time
    for (const part of Object.keys(GONE)) if (isGone[part]) this.#gone.set(part, why);
    if (isGone.held) this.#lose({ kind: "released_by_fault", monotonic_s: atS, message: `${why}: ${GONE.held}` });
    this.#tellGone();
  }

  /* What is gone is said until it has been read or the jaws are moved; each part as long as it is so. */
  #tellGone() {
    if (!this.#gone.size) return this.forgive("gone");
    const parts = [...this.#gone.keys()].map((part) => GONE[part]).join(", ");
    const isHeld = this.#gone.has("held");
    const take = this.#gone.has("control") ? "“Take control”, " : "";
    const advice = isHeld && this.#operates ? `${take}${AGAIN}; ` : "";
    const text = capital(`${advice}${[...this.#gone.values()].at(-1)}: ${parts}.`);
    const rank = isHeld ? "loss" : "";
    toast(this.channel, text, "gone", { rank, outlives: true, onRead: () => this.#forget() });
  }

  #forget() {
    if (this.#gone.has("held")) this.#lose(null);
    this.#gone.clear();
    this.#tellGone();
  }

  /* Say no more that `part` is gone: it is there again. */
  regain(part) {
    if (this.#gone.delete(part)) this.#tellGone();
  }

  #noteWeak(event) {
    if (event.kind !== "weak") return;
    this.#weak = event.data.weak ? event : null;
    this.#toldWeak = "";
    this.#isWeakRead = false;
    this.#showHeld();
    this.#showAlarms();
    if (this.#weak === null) this.forgive("weak");
    else this.#tellWeak();
  }

  /* Say in the bar that the motor is weak, first what to do about what it holds, or may hold. What has been read is
     said again for such a hold alone. */
  #tellWeak() {
    if (!this.#isWeak) return;
    const { hint, made_nm: made, commanded_nm: commanded } = this.#weak.data;
    const isHeld = this.state.is_grasped !== false;
    const act = isHeld ? `${SUPPORT}; ` : "";
    const text = `WEAK MOTOR: ${act}${hint}; it makes ${made.toFixed(2)} of the commanded ${figure(commanded, 2, "N·m")}`;
    if (text === this.#toldWeak || (this.#isWeakRead && !isHeld)) return;
    this.#toldWeak = text;
    this.#isWeakRead = false;
    toast(this.channel, text, "weak", {
      isOver: () => !this.#isWeak,
      atS: this.#weak.monotonic_s + this.#offsetS,
      onRead: () => (this.#isWeakRead = true),
    });
  }

  /* Keep where the jaws grip what they hold, and say in the bar that something pushes them clearly further open; and
     that it did, for the daemon says then that something is held. */
  #noteGrip({ is_grasped: isGrasped, opening_mm: mm, force_set_n: n, monotonic_s: atS }) {
    if (isGrasped === null || mm === null) return;
    const { mm: leastMm = mm, n: mostN = n } = this.#grip ?? {};
    this.#grip = isGrasped ? { mm: Math.min(mm, leastMm), n: Math.max(n, mostN) } : null;
    if (!isGrasped) return this.#forgetPush();
    const isPushed = mm - this.#grip.mm > Math.max(PUSHED_MM, PUSHED_MM_PER_N * this.#grip.n);
    if (isPushed === this.isPushedOpen) return;
    this.isPushedOpen = isPushed;
    if (isPushed) this.#pushedS = atS;
    if (this.#pushedS === null) return; // it has been read
    toast(this.channel, isPushed ? PUSHED : WAS_PUSHED, "pushed", {
      atS: this.#pushedS + this.#offsetS,
      onRead: () => (this.#pushedS = null),
    });
  }

  /* Nothing is held any more, or it is gripped anew: that the jaws were pushed open matters no more. */
  #forgetPush() {
    this.isPushedOpen = false;
    this.#pushedS = null;
    this.forgive("pushed");
  }

  /* Whether the coil's heat leaves a hold less than its set force. */
  get #isLowered() {
    return this.state?.force_set_n > 0 && this.state.limited.includes("heat");
  }

  /* Say in the bar what a hold that heat has lowered means, and what to do, as long as it is so. */
  #noteHeat() {
    if (this.#isLowered === this.#wasLowered) return;
    this.#wasLowered = this.#isLowered;
    if (this.#wasLowered) toast(this.channel, LOWERED, "heat", { isOver: () => !this.#isLowered });
  }

  /* Say in the bar what to do about a trouble of motor or bus, until a state shows that it is over. */
  #noteTrouble({ kind, data, monotonic_s: beganS }) {
    if (!Object.hasOwn(TROUBLES, kind)) return;
    const trouble = TROUBLES[kind](data);
    if (trouble === null) return this.#troubles.delete(kind);
    this.#troubles.set(kind, trouble);
    if (this.#lost?.kind === "released_by_fault" && !this.#isPast) return; // which says it, too
    const isOver = (state) => state.monotonic_s > beganS && !trouble.isIn(state);
    toast(this.channel, capital(trouble.text), kind, { isOver, rank: "trouble", atS: beganS + this.#offsetS });
  }

  /* What is known of the trouble that a state has; otherwise its bare name. */
  #troubleText(state, kind, bare) {
    const trouble = this.#troubles.get(kind);
    return trouble?.isIn(state) ? trouble.text : bare.replaceAll("_", " ");
  }

  get #isWeak() {
    return this.#weak !== null && Boolean(this.state?.enabled);
  }

  /* Say in the bar what is lost; what a restart did is said there with all else that it ended. */
  #tellLoss() {
    if (!this.#lost?.data || this.#lost.monotonic_s === this.#seenS) return;
    const { kind, monotonic_s: atS } = this.#lost;
    const text = `${LOSSES[kind]}: ${[...this.#troublesBefore(kind), this.#lossText()].join("; ")}`;
    if (text === this.#toldLoss) return;
    this.#toldLoss = text;
    toast(this.channel, text, "let go", {
      rank: "loss",
      outlives: true,
      atS: atS + this.#offsetS,
      onRead: () => {
        if (kind === "object_lost") this.#seenS = atS;
        else {
          this.#readS = atS;
          this.#lose(null);
        }
      },
    });
  }

  /* What troubles the gripper which has lost an object: that has to be put right first. What let go says it itself. */
  #troublesBefore(kind) {
    if (kind !== "object_lost" || this.state === null) return [];
    return [...this.#troubles.values()].filter(({ isIn }) => isIn(this.state)).map(({ text }) => text);
  }

  /* What is said of a loss, first what to do: of a lost object no hold, once the motor does not hold; without a daemon
     no advice. */
  #lossText() {
    const { data, monotonic_s: atS } = this.#lost;
    this.#isPast ||= this.state?.monotonic_s > atS && !["fault", "offline"].includes(this.state.mode);
    const first = (text) => [this.#graspAgain, text].filter(Boolean).join("; ");
    if ((this.#isPast || this.state === null) && data?.past) return first(data.past);
    if (data?.why) return letGo(this.#lost, this.#troubles.get("motor")?.act);
    const text = inPageWords(this.#lost.message, this.#lost.terms?.message);
    if (this.#lost.kind !== "object_lost") return first(text);
    const isHeld = this.state?.enabled && this.state.mode !== "relaxed";
    return first(isHeld ? text : text.split(": ", 1)[0]);
  }

  /* What to do about a lost object; of a fault or a silent motor that is said which comes before. */
  get #graspAgain() {
    if (this.state === null || ["fault", "offline"].includes(this.state.mode)) return "";
    return `${this.state.enabled ? "" : "“Enable”, "}“Open”, then “Grasp” again`;
  }

  #showLoss() {
    this.#tellLoss();
    const { lost, "lost-text": text } = this.#nodes;
    const isLost = this.#lost !== null; // also while there is no connection
    const [name, told] = isLost ? [LOSSES[this.#lost.kind], this.#lossText()] : ["", ""];
    lost.hidden = !isLost;
    this.article.classList.toggle("has-lost", isLost);
    if (lost.textContent !== name) lost.textContent = name; // an alert is read out whenever it is written
    text.textContent = isLost ? `At ${time(this.#lost.monotonic_s + this.#offsetS)}: ${told}.` : "";
  }

  #show(state) {
    this.state = state;
    if (state.is_grasped) this.#heldS = state.monotonic_s;
    this.#noteGrip(state);
    this.#noteHeat();
    this.#tellWeak();
    if (state.stop !== null) {
      this.regain("stop");
      this.forgive("failed stop");
      this.miss(false);
    }
    if (this.#replay !== null && isReplaying(state)) {
      this.#moveOn();
      this.forgive("motion");
    }
    this.article.classList.remove("down");
    this.#showLoud();
    this.jaws.setScale(this.travel, state.work_stroke_mm ?? null);
    this.#showJaws(state);
    this.plots.add(this.#moment(state));
    if (!this.#isLate) this.#showMode(state);
    this.#showDoubt(state.scale_doubt);
    this.control.show(state);
    this.world.show(state);
    sweep(this.channel, state);
    this.#showFacts();
    this.dispatchEvent(new Event("state"));
  }

  #showJaws(state) {
    this.jaws.show({
      opening: state.opening_mm,
      command: this.#openingAt(state.command_rad),
      isGrasped: this.isPushedOpen ? null : state.is_grasped,
      isStale: this.isLastKnown,
    });
  }

  /* Show what the gripper does: badge, sentence and alert are made of one state, so they agree. */
  #showMode(state, age = 0) {
    const { mode, why, stopped, clear } = this.#nodes;
    const does = doing(state);
    const isFault = state.mode === "fault";
    this.#isGrasped = state.is_grasped;
    this.#showHeld();
    this.#showLoss();
    const isCleared = !stopped.hidden && state.stop === null;
    stopped.hidden = state.stop === null;
    clear.hidden = stopped.hidden || !this.#mayClear(state.stop);
    this.#showAlarms();
    this.#sayFirst(this.#isLate ? "why" : "lost-text");
    if (this.#isLate) {
      mode.dataset.mode = "late";
      mode.textContent = "late";
      const seconds = age === null || age < LATE_S ? "more than 1" : age.toFixed(1);
      const held = state.is_grasped === false ? "" : " What was held may be let go: a motor without commands lets go by itself.";
      why.textContent = `${OLD} No newer state has come for ${seconds} s: the daemon or litegripd-web stands still, or the link is slow.${held}`;
    } else if (state.stop !== null) {
      mode.dataset.mode = isFault ? "fault" : "stopped";
      mode.textContent = isFault ? "fault, STOPPED" : "STOPPED";
      const how = isFault || does === STILL ? "" : `it is ${does}`;
      why.textContent = capital([how, this.#reason(state), this.#howToLetGo(state)].filter(Boolean).join("; "));
    } else {
      mode.dataset.mode = does === STILL ? STILL : state.mode;
      mode.textContent = does === "holding" ? this.#howHeld : does;
      why.textContent = this.#lost === null ? this.#reason(state) : capital(this.#reason(state));
    }
    if (isCleared) this.#showWhole(false);
    if (state.stop === null) return;
    const { by, why: reason, since_s: since, level } = state.stop;
    const isPages = by === OWN_NAME && reason === STOP_WHY;
    const whose = isPages ? reason : by ?? "somebody unknown";
    const who = `${isPages ? "" : `(${level}) `}at ${time(since + this.#offsetS)} by ${whose}`;
    const how = clear.hidden ? " ('litegripctl clear')" : "";
    const told = this.isSilent
      ? `Stop latched ${who}, but the motor does not answer: cut its power.`
      : `Stopped ${who}. Nothing moves until it is cleared${how}.`;
    stopped.textContent = told + (reason && !isPages ? ` Why: ${reason}.` : "");
  }

  /* What lets go of what is squeezed behind a stop, which may be a finger. */
  #howToLetGo({ enabled, is_grasped: isGrasped, pressing_n: pressing }) {
    if (!enabled || (isGrasped === false && !isNumber(pressing))) return "";
    const take = this.control.has ? "" : "“Take control”, ";
    return `to let go of what is squeezed: ${this.#operates ? `${take}“Let go”` : "'litegripctl stop --level relax'"}`;
  }

  /* How what is held is held. */
  get #howHeld() {
    if (this.isPushedOpen) return "pushed open";
    return this.#isWeak || this.#isLowered ? "holding weakly" : "holding";
  }

  /* Say in the head of what is lost first, which says what to do, and then of a stop; or of why there is no newer
     state. */
  #sayFirst(name) {
    const { said, stopped, why, "lost-text": lost } = this.#nodes;
    const order = name === "why" ? [stopped, why, lost] : [lost, stopped, why];
    if (said.firstElementChild !== order[0]) said.replaceChildren(order[0], " ", order[1], " ", order[2]);
  }

  /* Show whether something is held; what nothing measures any more stays as it was then, and says so. */
  #showHeld() {
    const { held } = this.#nodes;
    const isOld = this.isLastKnown && this.#isGrasped !== null;
    held.dataset.on = this.#isGrasped ?? "unknown";
    const known = { true: "object detected", false: "nothing held", null: "object?" }[this.#isGrasped];
    const told = this.isPushedOpen ? "object?" : known;
    held.textContent = isOld ? `${told}, last known` : told;
    held.classList.toggle("last-known", isOld);
    this.article.classList.toggle("is-weak", this.#isWeak || this.#isLowered || this.isPushedOpen);
  }

  /* Show all that is said in the head, however long it is; or as much as there is room for. */
  #showWhole(isWhole) {
    this.#nodes.said.classList.toggle("whole", isWhole);
    this.#nodes.said.ariaExpanded = isWhole;
  }

  /* Say that the millimetres are probably wrong, as long as the daemon doubts them. */
  async #showDoubt(doubt) {
    if (doubt === this.#doubt) return;
    this.#doubt = doubt;
    const { doubted, "doubt-text": text } = this.#nodes;
    doubted.hidden = doubt === null;
    if (doubt === null) return;
    text.textContent = `The millimetres are probably wrong (${doubt}).`;
    try {
      const { scale_warning: why, terms } = await this.wire.call("calibration.get");
      if (why) {
        text.textContent = `The millimetres are probably wrong: ${inPageWords(why, terms?.scale_warning)}.`;
      }
    } catch (error) {
      text.textContent += ` Why is not known: ${error.message}`;
    }
  }

  #reason(state) {
    const troubles = [];
    if (state.bus !== "up") troubles.push(this.#troubleText(state, "bus", `bus: ${state.bus}`));
    if (state.mode === "fault") troubles.push(this.#troubleText(state, "motor", `the motor reports ${state.status}`));
    const lost = this.#lost === null ? "" : this.#lossText(); // it stands before, and may say it already
    const parts = troubles.filter((text) => !lost.includes(text));
    if (state.mode !== "fault" && state.stale) parts.push("what is shown is the motor's last report");
    if (!state.calibrated) parts.push("not calibrated");
    if (state.job) parts.push(`by ${owner(state.job.owner)}`);
    if (state.is_grasped === null) parts.push(state.motor === "silent" ? "something was held: whether it still is, is not known"
        : "the motor is too weak to tell if something is held");
    else if (this.isPushedOpen) parts.push("something pushed the jaws open: look if what they gripped is still between them");
    else if (isNumber(state.pressing_n)) parts.push(`the jaws press with about ${figure(state.pressing_n, 0, "N")}`);
    if (state.limited.length) parts.push(`limited by ${state.limited.join(", ").replaceAll("_", " ")}`);
    return parts.join("; ");
  }

  #showFacts() {
    const state = this.state ?? this.#last;
    const heat = this.#health?.heat;
    const clamp = state?.clamp_n;
    const lease = this.#lease;
    const toLimit = heat?.time_to_limit_s;
    const held = lease?.owner;
    const isOld = this.#isLate && lease !== null; // it takes the purpose's place: nothing moves
    this.#figure("Opening", figure(state?.opening_mm, 1, "mm"));
    this.#figure("Force", figure(state?.force_n, 1, "N"));
    this.#figure("Set force", figure(state?.force_set_n, 1, "N"));
    const felt = clamp && !this.isPushedOpen ? `${clamp[0].toFixed(1)} to ${clamp[1].toFixed(1)} N by the motor` : "--";
    this.#figure("Coil", figure(state?.coil_temperature_c, 0, "°C"));
    this.#figure("Driver", figure(state?.driver_temperature_c, 0, "°C"));
    this.#figure("Time to the heat limit", isNumber(toLimit) ? figure(toLimit, 0, "s") : heat ? "no limit" : "--");
    this.#showHealth();
    this.#figure("On the object", felt, "wide", UNSEEN);
    const has = held ? (isOld ? owner(held) : holder(held)) : lease ? "free" : "--";
    this.#fact("Lease", isOld ? `${has}, last known` : has, "wide").classList.toggle("last-known", isOld);
  }

  /* Health is a lamp with one sentence; the details are behind it. */
  #showHealth() {
    const { lamp, "health-text": text, "health-why": why } = this.#nodes;
    const { verdict, reasons = [], notes = [], terms } = this.#health ?? {};
    const told = (texts, places) => texts.map((line, row) => inPageWords(line, places?.[row]));
    const lines = [...told(reasons, terms?.reasons), ...told(notes, terms?.notes)];
    const isOld = this.#isLate && verdict !== undefined;
    lamp.dataset.verdict = isOld ? "unknown" : verdict ?? "unknown";
    const more = reasons.length > 1 ? `, and ${reasons.length - 1} more` : "";
    const first = reasons.length ? `: ${lines[0]}${more}` : "";
    const known = `${HEALTH[verdict] ?? verdict}${isOld ? ", last known" : ""}${first}`;
    const sentence = verdict ? known : "Health is not known";
    if (text.textContent !== sentence) text.textContent = sentence;
    if (why.dataset.lines === lines.join("\n")) return;
    why.dataset.lines = lines.join("\n");
    const shown = lines.length ? lines : ["Nothing is wrong."];
    why.replaceChildren(
      ...shown.map((line) => Object.assign(document.createElement("li"), { textContent: line })),
    );
  }

  /* A figure that is no longer measured says so; an unknown one is none. */
  #figure(name, value, kind = "", hint = "") {
    const isLastKnown = this.isLastKnown && !value.startsWith("--");
    const node = this.#fact(name, isLastKnown ? `${value}, last known` : value, kind, hint);
    node.classList.toggle("last-known", isLastKnown);
  }

  #fact(name, value, kind = "", hint = "") {
    let node = this.#facts.get(name);
    if (node === undefined) {
      const term = document.createElement("dt");
      term.textContent = name;
      term.className = kind;
      node = document.createElement("dd");
      node.className = kind;
      if (hint) node.title = hint;
      this.#nodes.facts.append(term, node);
      this.#facts.set(name, node);
    }
    if (node.textContent !== value) node.textContent = value;
    return node;
  }
}
