/* A dialog hangs from the bar: the page below is out of reach meanwhile, STOP in the bar never is. */

export function open(dialog) {
  dialog.onclose = guard;
  dialog.show(); // not showModal(), which puts all else out of reach, STOP too
  guard();
}

function guard() {
  const isOpen = document.querySelector("dialog[open]") !== null;
  for (const node of document.querySelectorAll("main, #dump, footer")) node.inert = isOpen;
}
