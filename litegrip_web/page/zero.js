/* Measuring the travel moves the jaws to both stops: so it asks first, and can be cancelled.

   How far the jaws open is asked, too: the scale follows from it. It can be corrected alone. */

import { ask } from "./ask.js";
import { open } from "./dialog.js";
import { numberIn, typed } from "./fields.js";
import { figure, isNumber } from "./format.js";
import { SPAN_INSET_MM, STROKE_RANGE_MM, TEMPLATES_RAD_TO_MM } from "./motions.js";

const PHASES = {
  probe_open: "step 1 of 5, the jaws open until they meet a stop",
  probe_closed: "step 2 of 5, they close until they meet one",
  confirm_open: "step 3 of 5, they open once more",
  confirm_closed: "step 4 of 5, they close once more",
  back_off: "step 5 of 5, they open a little",
};
const typedOpenings = new Map(); // by the channel: what was typed, and the daemon's figure at that time

/* How far the jaws open by a calibration of this travel, in mm. */
const opens = (travel) => Number((travel - SPAN_INSET_MM).toFixed(2));

/* Ask, and measure or correct when the answer is yes. */
export function askZero(panel) {
  const dialog = document.getElementById("zero");
  const [start, rescale, cancel, mount, stroke, uses, progress] = [
    "start", "rescale", "cancel", "mount", "stroke", "uses", "progress",
  ].map((name) => document.getElementById(`zero-${name}`));
  const { rad_to_mm: scale, stroke_mm: configured } = panel.gripper;
  const isDoubtful = TEMPLATES_RAD_TO_MM.includes(scale) || Boolean(panel.state?.scale_doubt);
  let inUse = isNumber(panel.gripper.travel_mm) ? opens(panel.gripper.travel_mm) : null;
  let job = null;
  let isBusy = false;

  /* The measured opening, if the person gave another one than is configured. */
  const given = () => {
    const mm = typed(stroke);
    return !isNumber(mm) || mm === configured ? {} : { stroke_mm: mm };
  };
  const used = (mm) =>
    mm === configured ? `the configured ${configured} mm` : `${mm} mm (configured: ${configured} mm)`;
  const showUses = () => {
    const now = inUse === null ? "There is no scale yet" : `Now the scale uses ${inUse} mm`;
    const next = given().stroke_mm ?? configured;
    const isWrong = Number.isNaN(typed(stroke));
    const would = next === inUse || isWrong ? "" : `; it would use ${next} mm`;
    uses.textContent = `${now}${would} (configured: ${configured} mm). All lengths and speeds follow from it.`;
  };

  /* Say what is wrong with the figure, which nothing is done with then; return whether anything is. */
  const isWrongFigure = () => {
    const isWrong = numberIn(stroke) === null;
    if (isWrong) progress.textContent = `How far the jaws open: ${stroke.validationMessage}`;
    return isWrong;
  };

  /* Do `act` with the answers, and show what it returns. */
  const run = async (wrong, act) => {
    setBusy(true);
    dialog.classList.remove("done");
    const params = { ...given(), stop_generation: panel.state?.stop_generation ?? 0 };
    try {
      const done = await act(params);
      cancel.textContent = "Done";
      dialog.classList.add("done");
      progress.textContent = done;
    } catch (error) {
      cancel.textContent = "Back";
      progress.textContent = `${wrong}: ${error.message}`;
    }
    showUses();
    job = null;
    cancel.disabled = false;
    setBusy(false);
  };

  const measure = async (params, as) => {
    cancel.textContent = "Stop measuring";
    cancel.disabled = true; // there is nothing yet that it could stop
    progress.textContent = "The jaws move.";
    const { value: chosen } = mount.querySelector(":checked");
    if (chosen) params.mount = chosen;
    const result = await panel.wire.call("calibration.zero", { ...params, progress: true }, (step) => {
      job = step.job;
      cancel.disabled = false;
      progress.textContent = `${PHASES[step.phase] ?? step.phase.replaceAll("_", " ")}: ${figure(step.torque_nm, 2, "N·m")}`;
    });
    if (!result.ok) throw new Error(result.message ?? result.outcome.replaceAll("_", " "));
    const travel = result.travel_rad * result.rad_to_mm;
    inUse = opens(travel);
    return (
      `Measured: ${figure(travel, 1, "mm")} of travel with ${SPAN_INSET_MM} mm of pressing, saved${as === mountNow ? "" : `, mount ${as}`}. ` +
      `The scale uses ${used(inUse)}. If a caliper shows another opening, enter it and press ` +
      "“Correct the scale only”, or run 'litegripctl calibration rescale --stroke-mm MM'."
    );
  };

  const correct = async (params) => {
    const { travel_mm: travel } = await panel.wire.call("calibration.rescale", params);
    inUse = opens(travel);
    const corrected = `Corrected: ${figure(travel, 1, "mm")} of travel; the scale uses ${used(inUse)}`;
    try {
      await panel.wire.call("calibration.save");
    } catch (error) {
      return `${corrected}. It is in use, but not saved: ${error.message}`;
    }
    return `${corrected}. It is saved.`;
  };

  const figureOf = () => (isDoubtful ? configured : inUse ?? configured); // a template's was measured on no gripper
  [stroke.min, stroke.max] = STROKE_RANGE_MM;
  const typedBefore = typedOpenings.get(panel.channel);
  stroke.value = typedBefore?.of === figureOf() ? typedBefore.text : figureOf();
  stroke.oninput = () => {
    typedOpenings.set(panel.channel, { text: stroke.value, of: figureOf() });
    showUses();
  };
  showUses();
  progress.textContent = "";
  mount.querySelector("input").checked = true;
  cancel.textContent = "Cancel";
  dialog.classList.remove("done");
  const mountNow = panel.state?.mount ?? null;
  document.getElementById("zero-mount-now").textContent = mountNow === null ? "" : ` (${mountNow})`;
  start.onclick = async () => {
    if (isWrongFigure()) return;
    const chosen = mount.querySelector(":checked").value || mountNow;
    const text = `The mount is “${mountNow}” now. As “${chosen}” the jaws close where they open now, and the other way round: all openings are inverse then, if it is not mounted so.`;
    const isMeant = chosen === mountNow || (await ask(panel, text, `It is mounted ${chosen}`, "motion"));
    if (isMeant) await run("Not measured", (params) => measure(params, chosen));
    else settle();
  };
  rescale.onclick = async () => {
    if (isWrongFigure()) return;
    const mm = given().stroke_mm ?? configured;
    const text = `The scale will use ${mm} mm, in place of ${inUse ?? "--"} mm, and is saved. All lengths and speeds follow from it.`;
    const isMeant = await ask(panel, text, "Correct and save", "control");
    if (isMeant) await run("Not corrected", correct);
    else settle();
  };
  cancel.onclick = async () => {
    if (job !== null) {
      try {
        await panel.wire.call("job.cancel", { job });
      } catch (error) {
        progress.textContent = error.message;
      }
      return;
    }
    dialog.close();
  };
  const settle = open(dialog, panel, () => isBusy);
  const setBusy = (value) => {
    isBusy = mount.disabled = stroke.disabled = value;
    settle();
  };
}
