/* A dump that is dropped onto the page: its plots and its events. Nothing of it leaves the browser. */

import { isNumber, time } from "./format.js";
import { Plots } from "./plots.js";
import { toast, untoast } from "./toasts.js";

const NM_PER_N = 0.1;
const MOST_BYTES = 64 * 1024 * 1024; // a dump of a minute has about 2

/* Return 1 where closing runs by increasing radians, else -1: a torque that closes is a force. */
function closingSign(ticks) {
  const first = ticks.find((tick) => tick.opening_mm !== undefined);
  const other = ticks.find((tick) => Math.abs(tick.opening_mm - first?.opening_mm) > 0.1);
  if (other === undefined) return 1;
  const opens = (other.opening_mm - first.opening_mm) * (other.position_rad - first.position_rad);
  return opens > 0 ? -1 : 1;
}

/* Return what is in a file; throws Error for what is no dump. */
function read(file, onProgress) {
  if (file.size > MOST_BYTES) {
    const most = MOST_BYTES / 1024 / 1024;
    throw new Error(`it has ${(file.size / 1024 / 1024).toFixed(0)} MiB, more than the ${most} MiB that are shown here`);
  }
  const worker = new Worker("dump_worker.js", { type: "module" });
  return new Promise((resolve, reject) => {
    worker.onerror = ({ message }) => reject(new Error(message || "its reader failed"));
    worker.onmessage = ({ data: { share, dump, error } }) => {
      if (share !== undefined) onProgress(share);
      else if (error !== undefined) reject(new Error(error));
      else resolve(dump);
    };
    worker.postMessage(file);
  }).finally(() => worker.terminate());
}

/* Show `file` in `place`; say in `notice` how much of it is read. What is wrong with one that is no dump is said until
   that has been read, or another one is opened or closed. */
export async function showDump(file, place, notice) {
  let dump;
  try {
    dump = await read(file, (share) => notice(`${file.name}: ${Math.round(100 * share)} % read`));
  } catch (error) {
    notice("");
    toast(null, `${file.name} cannot be shown: ${error.message}`, "dump", {});
    return;
  }
  untoast(null, "dump");
  const { ticks, events } = dump;
  const title = document.createElement("h2");
  title.id = "dump-title";
  const seconds = (ticks.at(-1).time - ticks[0].time).toFixed(1);
  title.textContent = `${file.name}: ${seconds} s, ${ticks.length} ticks`;
  const close = document.createElement("button");
  close.type = "button";
  close.textContent = "Put away";
  close.onclick = () => {
    untoast(null, "dump");
    place.hidden = true;
    place.replaceChildren();
  };
  const plots = document.createElement("div");
  plots.className = "plots";
  const list = document.createElement("ol");
  list.className = "events";
  for (const event of events) {
    const line = document.createElement("li");
    const when = document.createElement("time");
    when.textContent = time(event.time);
    const words = document.createElement("span");
    words.textContent = event.message;
    line.append(when, words);
    list.prepend(line); // the newest first
  }
  place.replaceChildren(title, close, plots, list);
  place.hidden = false;
  const column = (name, factor = 1) =>
    ticks.map((tick) => (isNumber(tick[name]) ? tick[name] * factor : null));
  const nPerNm = closingSign(ticks) / NM_PER_N;
  new Plots(plots, file.name).show({
    time: ticks.map((tick) => tick.time),
    opening: column("opening_mm"),
    command: column("command_mm"),
    force: column("torque_nm", nPerNm),
    set: column("command_torque_nm", nPerNm),
  });
  place.scrollIntoView();
  notice("");
}
