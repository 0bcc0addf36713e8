/* The number in a field, or what may stand there, in this page's own words. */

/* Return the number, undefined for an empty field that needs none; null for a wrong one, which is said there. */
export function numberIn(node) {
  node.setCustomValidity("");
  if (node.validity.valid) return node.value === "" ? undefined : Number(node.value);
  const { min, max, value, validity } = node;
  const bounds = min !== "" && max !== "" ? `from ${min} to ${max}` : "a number of";
  const given = validity.badInput ? "is no number" : value === "" ? "is empty" : `is ${value}`;
  node.setCustomValidity(`It may be ${bounds} ${node.dataset.unit}, and ${given}.`);
  node.addEventListener("input", () => node.setCustomValidity(""), { once: true });
  node.reportValidity();
  return null;
}
