/* How figures, times and outcomes read. Unknown is "--", never 0. */

import { WHY_NOT } from "./motions.js";

export const isNumber = (value) => typeof value === "number" && Number.isFinite(value);

export function figure(value, digits, unit) {
  if (!isNumber(value)) return `-- ${unit}`;
  const rounded = Number(value.toFixed(digits)) || 0; // not -0
  return `${rounded.toFixed(digits)} ${unit}`;
}

export function time(seconds) {
  return new Date(seconds * 1000).toLocaleTimeString("en-GB");
}

export function owner(program) {
  return program ? `${program.program} (pid ${program.pid})` : "nobody";
}

/* A program with what it has the gripper for, if it says more than its name. */
export function holder({ program, pid, purpose }) {
  const more = purpose && purpose !== program ? `, ${purpose}` : "";
  return `${owner({ program, pid })}${more}`;
}

/* A text that begins a sentence. */
export function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/* What the daemon's messages name, in the words of this page: its buttons and fields, and for what it has
   none of the command that does it (see litegrip_client/values/voices.py). */
const WORDS = {
  "calibration.get": "'litegripctl calibration'",
  "calibration.load": "'litegripctl calibration load'",
  "calibration.manual": "'litegripctl calibration manual'",
  "calibration.rescale": "“Correct the scale only”",
  "calibration.save": "'litegripctl calibration save'",
  "calibration.templates": "'litegripctl calibration templates'",
  "calibration.zero": "“Zero …”",
  "clients.list": "'litegripctl clients'",
  "config.get": "'litegripctl config'",
  "config.set": "'litegripctl config set'",
  "daemon.restart": "'litegripctl restart'",
  "events.subscribe": "“Events”",
  health: "“Healthy”",
  "info.get": "'litegripctl info'",
  "job.cancel": "'litegripctl cancel'",
  "job.list": "“Events”",
  "job.wait": "“Events” tell when it ends",
  "lease.acquire": "“Take control”",
  "lease.get": "“Lease”",
  "lease.release": "“Give control back”",
  "lease.take": "“Take it over”",
  "motion.close": "“Close”",
  "motion.grasp": "“Grasp”",
  "motion.hold": "“Hold”",
  "motion.move": "“Opening to go to”",
  "motion.open": "“Open”",
  "motion.set_force": "“Set force”",
  "motion.zero_gravity": "“Let go”",
  "motor.clear_fault": "“Clear the fault”",
  "motor.disable": "“Disable”",
  "motor.enable": "“Enable”",
  "motor.read_register": "'litegripctl register'",
  "motor.scan": "'litegripctl doctor --scan'",
  "recorder.dump": "'litegripctl dump'",
  "rpc.discover": "'litegripctl discover'",
  "sim.fault": "“Fault”",
  "sim.heat": "'litegripctl sim heat'",
  "sim.object": "“Put in” and “Take away”",
  "sim.push": "“Push open” and “Push closed”",
  "sim.reset": "“Reset”",
  "state.get": "what this page shows",
  "state.subscribe": "what this page shows",
  stop: "STOP",
  "stop.clear": "“Clear the stop”",
  "teleop.start": "'litegripctl teleop'",
  "teleop.status": "'litegripctl teleop status'",
  "teleop.stop": "'litegripctl teleop stop'",
  "trajectory.delete": "'litegripctl trajectories delete'",
  "trajectory.list": "the field “Name”",
  "trajectory.play": "“Replay”",
  "trajectory.record_start": "“Teach”",
  "trajectory.record_stop": "“End and keep”",
};

/* Parameters of the method that a message answers, as the fields read in which they were given. */
const FIELDS = {
  force_n: "“Force”",
  mount: "“Mount”",
  name: "“Name”",
  opening_mm: "“Opening to go to”",
  speed: "“Speed ×”",
  speed_mm_s: "“Speed”",
  stroke_mm: "“The jaws open”",
  width_mm: "“Object”",
};

/* What a page gives as its stops' reason, and what the daemon's texts say of one then. */
export const STOP_WHY = "STOP on the page";
const PAGES_STOP = /a stop \(hold\) by litegripd-web \(pid \d+\): STOP on the page/g;
const BROKEN_OFF = /^job \d+, (\w+), was broken off: /; // which one, stands before it on the page

/* A text of the daemon's with the page's words in the place of methods, parameters, jobs and its own stops; `terms` say
   where the first two are. */
export function inPageWords(text, terms = []) {
  const letters = [...text]; // places are counted in characters, as Python does
  let words = "";
  let at = 0;
  for (const { start, end, method, parameter } of terms) {
    const [table, name] = method === null ? [FIELDS, parameter] : [WORDS, method];
    if (!Object.hasOwn(table, name)) continue;
    words += letters.slice(at, start).join("") + table[name];
    at = end;
  }
  words += letters.slice(at).join("");
  const how = (_all, kind) => (kind === "record" ? "" : "broken off: "); // that of a recording is said, too
  return words.replace(BROKEN_OFF, how).replace(PAGES_STOP, STOP_WHY);
}

const KINDS = { record: "teach", play: "replay" };

/* A kind of job, in the words of this page's buttons. */
export const kindName = (kind) => KINDS[kind] ?? kind;

/* What a motion ended with, in words: "grasp: object held, 40.1 mm, force set to 10.0 N", which nobody has measured;
   and of one that ended wrongly why. */
export function outcome(kind, result) {
  const parts = [];
  if (kind === "record" && result.outcome === "stopped") parts.push("ended"); // by its own button, not by STOP
  else if (result.outcome) parts.push(result.outcome.replaceAll("_", " "));
  else if (result.ok !== undefined) parts.push(result.ok ? "done" : "failed");
  if (isNumber(result.width_mm)) parts.push(figure(result.width_mm, 1, "mm"));
  if (isNumber(result.force_n)) parts.push(`force set to ${figure(result.force_n, 1, "N")}`);
  if (result.message) parts.push(inPageWords(result.message, result.terms?.message));
  const why = result.ok === false && !result.message ? WHY_NOT[result.outcome] : undefined;
  return `${kindName(kind)}: ${parts.join(", ") || "done"}${why ? `: ${why}` : ""}`;
}
