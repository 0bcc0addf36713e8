/* The list of events, the newest first; how a job ended stands with its end. */

import { inPageWords, kindName, outcome, time } from "./format.js";
import { isWarning } from "./severity.js";

const MOST = 100;

export class Events {
  #place;
  #wire;
  #last = 0;
  #epoch = null;

  constructor(place, wire) {
    this.#place = place;
    this.#wire = wire;
  }

  /* Begin again, with what a new subscription told, to the daemon whose start is `epoch`; what one before it has told
     stays. */
  begin(events, offsetS, epoch) {
    for (const line of [...this.#place.children]) if (line.dataset.epoch === String(epoch)) line.remove();
    this.#epoch = epoch;
    this.#last = 0;
    for (const event of events) this.add(event, offsetS);
  }

  /* Add an event; `offsetS` makes the daemon's clock the time of day. */
  add(event, offsetS) {
    if (event.seq <= this.#last) return;
    this.#last = event.seq;
    const line = document.createElement("li");
    const when = document.createElement("time");
    when.textContent = time(event.monotonic_s + offsetS);
    const text = document.createElement("span");
    const told = inPageWords(event.message, event.terms?.message);
    text.textContent = told.replace(/^(job \d+: )(\w+)/, (_whole, job, kind) => job + kindName(kind));
    line.append(when, text);
    line.dataset.kind = event.kind;
    line.dataset.epoch = this.#epoch;
    line.classList.toggle("warning", isWarning(event));
    this.#place.prepend(line);
    while (this.#place.children.length > MOST) this.#place.lastChild.remove();
    if (event.kind === "job_ended") this.#tellOutcome(event, line, text);
  }

  async #tellOutcome(event, line, text) {
    let job;
    try {
      job = await this.#wire.call("job.get", { job: event.data.job });
    } catch {
      return; // the daemon keeps no job for ever; the event says how it ended, too
    }
    const took = job.ended_s === null ? "" : `, ${(job.ended_s - job.started_s).toFixed(1)} s`;
    const why = job.error && inPageWords(job.error.message, job.error.data.terms?.message);
    const how = job.error ? `${kindName(job.kind)}: ${why}` : outcome(job.kind, job.result ?? {});
    const whole = why?.startsWith(`job ${job.job}, `) ? why : `job ${job.job}, ${how}`;
    text.textContent = `${whole}${took}`;
    line.classList.toggle("warning", job.state === "failed");
  }
}
