/* A dialog hangs from the bar: the page below is out of reach meanwhile, STOP in the bar never is. */

/* Show a dialog of `panel`'s, in which what needs something obeys the rule of the page's other buttons, and waits
   while `isBusy`. Return what looks again whether it is. */
export function open(dialog, panel, isBusy = () => false) {
  const barred = dialog.querySelector(".barred");
  const allow = () => {
    let told = null;
    for (const node of dialog.querySelectorAll("[data-needs]")) {
      const why = panel.control.whyNot(node.dataset.needs);
      node.disabled = why !== null || isBusy();
      told ??= why;
    }
    const text = told === null ? "" : `Not now: ${told}.`;
    if (barred.textContent !== text) barred.textContent = text;
  };
  panel.addEventListener("allowed", allow);
  dialog.onclose = () => {
    panel.removeEventListener("allowed", allow);
    guard();
  };
  allow();
  dialog.show(); // not showModal(), which puts all else out of reach, STOP too
  guard();
  return allow;
}

function guard() {
  const isOpen = document.querySelector("dialog[open]") !== null;
  for (const node of document.querySelectorAll("main, #dump, footer")) node.inert = isOpen;
}
