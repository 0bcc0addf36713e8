/* Which events are warnings: made by docs/generate.py, not by hand. */

const WARNINGS = new Set(["stop", "second_master", "implausible", "client_lost", "object_lost", "released_by_fault", "pressing", "swing", "heat", "lease_lost", "refused"]);

export function isWarning({ kind, data }) {
  return !data.at_rest && Boolean(WARNINGS.has(kind) || data.error || data.warning);
}
