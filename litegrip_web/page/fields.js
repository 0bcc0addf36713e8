/* The number in a field, or what may stand there, in this page's own words.

   The fields are of text: one of the type "number" drops a comma in silence, and "12,5" is 125 then. */

const NUMBER = /^[+-]?(\d+\.?\d*|\.\d+)$/;

/* Return the number in a field, in which a comma is a point; undefined for an empty one, NaN for what is no number. */
export function typed({ value }) {
  const text = value.trim().replace(",", ".");
  if (text === "") return undefined;
  const number = NUMBER.test(text) ? Number(text) : NaN;
  return Number.isFinite(number) ? number : NaN;
}

/* Let a field say what is wrong with what stands in it, which is nothing if it may stand there. */
function check(node) {
  const { min, max, required, value, dataset } = node;
  const number = typed(node);
  let given = "";
  if (Number.isNaN(number)) given = "is no number";
  else if (number === undefined) given = required ? "is empty" : "";
  else if ((min !== "" && number < min) || (max !== "" && number > max)) given = `is ${value.trim()}`;
  const bounds = min !== "" && max !== "" ? `from ${min} to ${max}` : "a number of";
  node.setCustomValidity(given && `It may be ${bounds} ${dataset.unit}, and ${given}.`);
}

addEventListener("input", ({ target }) => target.inputMode === "decimal" && check(target));

/* Return the number, undefined for an empty field that needs none; null for a wrong one, which is said there. */
export function numberIn(node) {
  check(node);
  return node.reportValidity() ? typed(node) : null;
}
