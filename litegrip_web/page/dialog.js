/* A dialog hangs from the bar: the page below is out of reach meanwhile, STOP in the bar never is. */

/* Show a dialog of `panel`'s, in which what needs something obeys the rule of the page's other buttons, and waits
   while `isBusy`; what moves says that it drops what is held. Return what looks again whether it is. */
export function open(dialog, panel, isBusy = () => false) {
  const [barred, drops] = [".barred", ".drops"].map((name) => dialog.querySelector(name));
  const allow = () => {
    let told = null;
    for (const node of dialog.querySelectorAll("[data-needs]")) {
      const why = panel.control.whyNot(node.dataset.needs);
      node.disabled = why !== null || isBusy();
      told ??= why;
    }
    const moves = dialog.querySelector('[data-needs="motion"]') !== null;
    const isHeld = moves && panel.state?.is_grasped === true;
    say(drops, isHeld ? "Something is held: it will drop." : "");
    say(barred, told === null ? "" : `Not now: ${told}.`);
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

function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function guard() {
  const isOpen = document.querySelector("dialog[open]") !== null;
  for (const node of document.querySelectorAll("main, #dump, footer")) node.inert = isOpen;
}
