/* How figures, times and outcomes read. Unknown is "--", never 0. */

export const isNumber = (value) => typeof value === "number" && Number.isFinite(value);

export function figure(value, digits, unit) {
  return isNumber(value) ? `${value.toFixed(digits)} ${unit}` : `-- ${unit}`;
}

export function time(seconds) {
  return new Date(seconds * 1000).toLocaleTimeString("en-GB");
}

export function owner(program) {
  return program ? `${program.program} (pid ${program.pid})` : "nobody";
}

/* Methods that the daemon's messages name, as the buttons of this page read. */
const BUTTONS = {
  "stop.clear": "Clear the stop",
  "lease.acquire": "Take control",
  "lease.take": "Take it over",
  "lease.release": "Give control back",
  "motor.enable": "Enable",
  "motor.disable": "Disable",
  "motor.clear_fault": "Clear the fault",
  "motion.hold": "Hold",
  "motion.zero_gravity": "Let go",
  "calibration.zero": "Zero",
  "calibration.rescale": "Correct the scale only",
  "trajectory.record_stop": "End and keep",
};

/* A text of the daemon's with the buttons in the place of methods; `terms` say where those are. */
export function inPageWords(text, terms = []) {
  const letters = [...text]; // places are counted in characters, as Python does
  let words = "";
  let at = 0;
  for (const { start, end, method } of terms) {
    if (!Object.hasOwn(BUTTONS, method)) continue;
    words += `${letters.slice(at, start).join("")}“${BUTTONS[method]}”`;
    at = end;
  }
  return words + letters.slice(at).join("");
}

/* What a motion ended with, in words: "grasp: held, 40.1 mm, 10.0 N". */
export function outcome(kind, result) {
  const parts = [];
  if (result.outcome) parts.push(result.outcome.replaceAll("_", " "));
  else if (result.ok !== undefined) parts.push(result.ok ? "done" : "failed");
  if (isNumber(result.width_mm)) parts.push(figure(result.width_mm, 1, "mm"));
  if (isNumber(result.force_n)) parts.push(figure(result.force_n, 1, "N"));
  if (result.message) parts.push(inPageWords(result.message, result.terms?.message));
  return `${kind}: ${parts.join(", ") || "done"}`;
}
