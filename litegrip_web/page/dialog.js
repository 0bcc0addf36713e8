/* A dialog hangs from the bar: the page below is out of reach meanwhile, STOP in the bar never is. */

const DEAF_MS = 1000; // longer than between the two clicks of somebody who clicks twice
const deafened = new WeakMap(); // by a button, the timer that ends it
let clicked = null; // where, and when

/* Show a dialog of `panel`'s, which names it where there are several, and in which what needs something obeys the rule
   of the page's other buttons, and waits while `isBusy`; what moves says that it drops what is held. What moves or
   saves is deaf for a moment at first, and whenever what is returned is called, which says that the dialog shows
   something else now: a click that was meant for what was there before does nothing. */
export function open(dialog, panel, isBusy = () => false) {
  const barred = dialog.querySelector(".barred");
  let deaf = 0;
  const allow = () => {
    let told = null;
    for (const node of dialog.querySelectorAll("[data-needs]")) {
      const why = panel.control.whyNot(node.dataset.needs);
      node.disabled = why !== null || deaf !== 0 || isBusy();
      told ??= why;
    }
    const moves = dialog.querySelector('[data-needs="motion"]') !== null;
    const isHeld = moves && panel.state?.is_grasped === true;
    dialog.classList.toggle("drops", isHeld);
    const drops = isHeld ? "Something is held: it will drop." : "";
    say(barred, [drops, told === null ? "" : `Not now: ${told}.`].filter(Boolean).join(" "));
  };
  const settle = () => {
    clearTimeout(deaf);
    deaf = setTimeout(() => {
      deaf = 0;
      allow();
    }, DEAF_MS);
    allow();
  };
  dialog.querySelector(".whose").textContent = panel.whose;
  panel.addEventListener("allowed", allow);
  dialog.onclose = () => {
    clearTimeout(deaf);
    panel.removeEventListener("allowed", allow);
    guard();
  };
  settle();
  dialog.show(); // not showModal(), which puts all else out of reach, STOP too
  dialog.querySelector(".told").scrollTop = 0; // what is focused may be further down
  guard();
  return settle;
}

/* Have buttons that have come to stand where another was clicked be deaf to clicks for a moment: who clicks twice means
   that one. They look so. */
export function deafen(...buttons) {
  for (const button of buttons) {
    clearTimeout(deafened.get(button));
    button.classList.add("deaf");
    deafened.set(button, setTimeout(() => button.classList.remove("deaf"), DEAF_MS));
  }
}

addEventListener("click", ({ clientX: x, clientY: y, detail }) => detail && (clicked = { x, y, ms: performance.now() }), true);

function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/* Within reach is the upper dialog, if there is one; otherwise the page, but for what stood behind the click that has
   closed the dialog. */
function guard() {
  const opened = [...document.querySelectorAll("dialog[open]")];
  for (const node of document.querySelectorAll("main, #dump, footer")) node.inert = opened.length > 0;
  for (const dialog of opened) dialog.inert = dialog !== opened.at(-1);
  if (opened.length || clicked === null || performance.now() - clicked.ms > DEAF_MS) return;
  const behind = document.elementFromPoint(clicked.x, clicked.y)?.closest("main button:not(.stop-one)");
  if (behind) deafen(behind);
}
