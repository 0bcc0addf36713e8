/* One gripper: what is known of it, kept up to date, and shown. */

import { Control } from "./control.js";
import { Events } from "./events.js";
import { figure, inPageWords, isNumber, owner, time } from "./format.js";
import { Jaws } from "./jaws.js";
import { Plots } from "./plots.js";
import { Wire } from "./wire.js";
import { World } from "./world.js";

const HZ = 20;
const LOOK_EVERY_MS = 1000;
const QUIET_MS = 1500;
const UNSEEN =
  "No software sees what else pushes the jaws, a hand or a weight, nor a motor that makes other than it reports.";

export class Panel {
  #nodes = {};
  #offsetS = 0;
  #doubt;
  #lease = null;
  #health = null;
  #lastSampleMs = 0;
  #facts = new Map();
  gripper = null;
  state = null;

  constructor(channel, token, place) {
    const article = document.getElementById("gripper").content.cloneNode(true).firstElementChild;
    article.setAttribute("aria-label", `Gripper ${channel}`);
    article.dataset.channel = channel;
    place.append(article);
    for (const node of article.querySelectorAll("[data-is], [data-do]")) {
      this.#nodes[node.dataset.is ?? node.dataset.do] = node;
    }
    this.article = article;
    this.channel = channel;
    this.#nodes.channel.textContent = channel;
    this.wire = new Wire(channel, token);
    this.events = new Events(this.#nodes.events, this.wire);
    this.plots = new Plots(this.#nodes.plots, channel);
    this.world = new World(this);
    this.jaws = new Jaws(this.#nodes.jaws, this.world);
    this.control = new Control(this);
    this.#nodes.stop.onclick = () => this.stop();
    const { wire } = this;
    wire.addEventListener("up", ({ detail }) => this.#begin(detail));
    wire.addEventListener("down", ({ detail }) => this.#end(detail.message));
    wire.addEventListener("state.sample", ({ detail }) => this.#show(detail.state));
    wire.addEventListener("event", ({ detail }) => this.#take(detail));
    setInterval(() => this.#look(), LOOK_EVERY_MS);
  }

  node(name) {
    return this.#nodes[name];
  }

  /* Say how something ended, or what is wrong with it. */
  tell(text) {
    this.#nodes.outcome.textContent = text;
  }

  /* Stop this gripper; return whether the daemon has confirmed it. */
  async stop() {
    try {
      await this.wire.call("stop", { level: "hold", why: "STOP on the page" });
      this.tell("stopped");
      return true;
    } catch (error) {
      this.tell(`STOP did not reach ${this.channel}: ${error.message}. Cut the power.`);
      return false;
    }
  }

  async #begin({ operate }) {
    for (const node of this.article.querySelectorAll("[data-acts]")) node.hidden = !operate;
    try {
      const hello = await this.wire.call("hello", { client: "litegripd-web" });
      this.#offsetS = Date.now() / 1000 - hello.monotonic_s;
      this.gripper = hello.gripper;
      const { ranges } = await this.wire.call("config.get");
      const events = await this.wire.call("events.subscribe");
      this.events.begin(events.events, this.#offsetS);
      const states = await this.wire.call("state.subscribe", { hz: HZ });
      this.tell("");
      this.#show(states.state);
      this.control.begin(operate, ranges);
      this.world.begin(hello.simulated, operate);
      await this.#look();
    } catch (error) {
      this.tell(error.message);
    }
  }

  #end(message) {
    this.state = null;
    this.#lease = this.#health = null;
    this.#nodes.mode.textContent = "no daemon";
    this.#nodes.mode.dataset.mode = "offline";
    this.#nodes.why.textContent = message;
    this.#nodes.stopped.hidden = this.#nodes.doubted.hidden = true;
    this.#doubt = undefined;
    this.article.classList.add("down");
    this.jaws.show({ opening: null, command: null, isGrasped: false, isStale: true });
    this.control.end();
    this.world.end();
    this.#showFacts();
  }

  async #look() {
    if (!this.wire.isUp || document.hidden) return;
    const quiet = performance.now() - this.#lastSampleMs > QUIET_MS;
    this.article.classList.toggle("quiet", quiet);
    if (quiet) this.#nodes.why.textContent = "the daemon sends no states";
    try {
      [this.#health, this.#lease] = await Promise.all([
        this.wire.call("health"),
        this.wire.call("lease.get"),
      ]);
    } catch {
      this.#health = this.#lease = null; // shown as unknown; "down" says why
    }
    this.control.showLease(this.#lease);
    this.#showFacts();
  }

  async #take(event) {
    this.events.add(event, this.#offsetS);
    if (event.kind === "lease" || event.kind === "lease_lost") await this.#look();
    if (event.kind === "calibration") {
      this.gripper = (await this.wire.call("hello", { client: "litegripd-web" })).gripper;
      this.#doubt = undefined; // the next state asks why, again
    }
  }

  /* How far the jaws travel, in mm: as calibrated, otherwise as configured. */
  get travel() {
    return this.gripper.travel_mm ?? this.gripper.stroke_mm;
  }

  /* Return the opening in mm at a motor position; null without a calibration. */
  #openingAt(rad) {
    const { closed_rad: closed, open_rad: open, travel_mm: travel } = this.gripper ?? {};
    if (![rad, closed, open, travel].every(isNumber) || open === closed) return null;
    return ((rad - closed) / (open - closed)) * travel;
  }

  #show(state) {
    this.state = state;
    this.#lastSampleMs = performance.now();
    this.article.classList.remove("down", "quiet");
    const opening = state.stale ? null : state.opening_mm;
    const command = this.#openingAt(state.command_rad);
    this.jaws.setScale(this.travel, state.work_stroke_mm ?? null);
    this.jaws.show({
      opening: state.opening_mm,
      command,
      isGrasped: state.is_grasped,
      isStale: state.stale,
    });
    this.plots.add({
      time: state.monotonic_s + this.#offsetS,
      opening,
      command,
      force: state.stale ? null : state.force_n,
      set: state.force_set_n,
    });
    this.#showMode(state);
    this.#showDoubt(state.scale_doubt);
    this.control.show(state);
    this.#showFacts();
  }

  #showMode(state) {
    const { mode, why, stopped, "stop-text": text } = this.#nodes;
    const phase = state.job?.phase ? ` (${state.job.phase})` : "";
    mode.dataset.mode = state.mode;
    mode.dataset.verdict = this.#health?.verdict ?? "";
    mode.textContent = state.job ? `${state.mode}: ${state.job.kind}${phase}` : state.mode;
    why.textContent = this.#reason(state);
    stopped.hidden = state.stop === null;
    if (state.stop === null) return;
    const { by, why: reason, since_s: since, level } = state.stop;
    const when = time(since + this.#offsetS);
    text.textContent =
      `Stopped (${level}) at ${when} by ${by ?? "somebody unknown"}${reason ? `: ${reason}` : ""}. ` +
      "Nothing moves until it is cleared: here by who has control, or with 'litegripctl clear'.";
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
    const parts = [];
    if (state.bus !== "up") parts.push(`bus: ${state.bus.replaceAll("_", " ")}`);
    if (state.mode === "fault") parts.push(`the motor reports ${state.status}`);
    else if (state.stale) parts.push("the motor does not answer: what is shown is its last report");
    if (!state.calibrated) parts.push("not calibrated");
    if (state.job) parts.push(`by ${owner(state.job.owner)}`);
    if (state.is_grasped) parts.push("something is held");
    else if (state.is_grasped === null) parts.push("something was held: whether it still is, is not known");
    else if (isNumber(state.pressing_n)) parts.push(`the jaws press with about ${figure(state.pressing_n, 0, "N")}`);
    if (state.limited.length) parts.push(`limited by ${state.limited.join(", ").replaceAll("_", " ")}`);
    return parts.join("; ");
  }

  #showFacts() {
    const { state } = this;
    const heat = this.#health?.heat;
    const clamp = state?.clamp_n;
    const lease = this.#lease;
    const toLimit = heat?.time_to_limit_s;
    const held = lease?.owner;
    const purpose = held?.purpose ? `, ${held.purpose}` : "";
    this.#fact("Opening", figure(state?.opening_mm, 1, "mm"));
    this.#fact("Force", figure(state?.force_n, 1, "N"));
    this.#fact("Set force", figure(state?.force_set_n, 1, "N"));
    const felt = clamp ? `${clamp[0].toFixed(1)} to ${clamp[1].toFixed(1)} N by the motor` : "--";
    this.#fact("On the object", felt, "", UNSEEN);
    this.#fact("Coil", figure(state?.coil_temperature_c, 0, "°C"));
    this.#fact("Driver", figure(state?.driver_temperature_c, 0, "°C"));
    this.#fact("Time to the heat limit", isNumber(toLimit) ? figure(toLimit, 0, "s") : heat ? "none" : "--");
    this.#fact("Tick lateness (99 %)", figure(this.#health?.control?.lateness.p99_us, 0, "µs"));
    const { verdict, reasons, notes = [], terms } = this.#health ?? {};
    const told = (texts, places) => texts.map((text, row) => inPageWords(text, places?.[row]));
    const why = () => [...told(reasons, terms?.reasons), ...told(notes, terms?.notes)];
    this.#fact("Health", verdict ? [verdict, ...why()].join(": ") : "--", "wide");
    this.#fact("Lease", held ? `${owner(held)}${purpose}` : lease ? "free" : "--", "wide");
  }

  #fact(name, value, kind = "", hint = "") {
    let node = this.#facts.get(name);
    if (node === undefined) {
      const term = document.createElement("dt");
      term.textContent = name;
      node = document.createElement("dd");
      node.className = kind;
      node.title = hint;
      this.#nodes.facts.append(term, node);
      this.#facts.set(name, node);
    }
    if (node.textContent !== value) node.textContent = value;
  }
}
