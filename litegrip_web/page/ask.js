/* A question before something of the user's is lost. */

import { open } from "./dialog.js";

let end = () => {};

/* Ask; return whether the answer was `yes`, the words on that button, which needs "motion" or "control" alone. The
   panel's "withdrawn" is a no: what was asked about is no longer so. */
export function ask(panel, text, yes, needs) {
  end(false);
  const dialog = document.getElementById("ask");
  const button = document.getElementById("ask-yes");
  document.getElementById("ask-text").textContent = text;
  button.textContent = yes;
  button.dataset.needs = needs;
  return new Promise((resolve) => {
    const withdraw = () => end(false);
    end = (answer) => {
      end = () => {};
      panel.removeEventListener("withdrawn", withdraw);
      dialog.close();
      resolve(answer);
    };
    panel.addEventListener("withdrawn", withdraw);
    button.onclick = () => end(true);
    document.getElementById("ask-no").onclick = () => end(false);
    open(dialog, panel);
  });
}
