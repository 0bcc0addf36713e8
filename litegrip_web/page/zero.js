/* Measuring the travel moves the jaws to both stops: so it asks first, and can be cancelled. */

import { figure } from "./format.js";

/* Ask, and measure when the answer is yes. */
export function askZero(panel) {
  const dialog = document.getElementById("zero");
  const [start, cancel, mount, progress] = ["start", "cancel", "mount", "progress"].map((name) =>
    document.getElementById(`zero-${name}`),
  );
  let job = null;
  progress.textContent = "";
  start.disabled = false;
  cancel.textContent = "Cancel";
  start.onclick = async () => {
    start.disabled = true;
    cancel.textContent = "Stop measuring";
    progress.textContent = "The jaws move.";
    const params = { progress: true, stop_generation: panel.state?.stop_generation ?? 0 };
    if (mount.value) params.mount = mount.value;
    try {
      const result = await panel.wire.call("calibration.zero", params, (step) => {
        job = step.job;
        progress.textContent = `${step.phase.replaceAll("_", " ")}: step ${step.step}, ${figure(step.torque_nm, 2, "N·m")}`;
      });
      progress.textContent = result.ok
        ? `Measured: ${figure(result.travel_rad * result.rad_to_mm, 1, "mm")} of travel, saved.`
        : `Not measured: ${result.message ?? result.outcome.replaceAll("_", " ")}`;
    } catch (error) {
      progress.textContent = `Not measured: ${error.message}`;
    }
    job = null;
    start.disabled = false;
    cancel.textContent = "Done";
  };
  cancel.onclick = async () => {
    if (start.disabled && job !== null) {
      try {
        await panel.wire.call("job.cancel", { job });
      } catch (error) {
        progress.textContent = error.message;
      }
      return;
    }
    dialog.close();
  };
  dialog.showModal();
}
