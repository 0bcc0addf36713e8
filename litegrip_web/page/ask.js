/* A question before something of the user's is lost. */

import { open } from "./dialog.js";

/* Ask; return whether the answer was `yes`, the words on that button, which needs "motion" or "control" alone. */
export function ask(panel, text, yes, needs) {
  const dialog = document.getElementById("ask");
  const button = document.getElementById("ask-yes");
  document.getElementById("ask-text").textContent = text;
  button.textContent = yes;
  button.dataset.needs = needs;
  return new Promise((resolve) => {
    const end = (answer) => {
      dialog.close();
      resolve(answer);
    };
    button.onclick = () => end(true);
    document.getElementById("ask-no").onclick = () => end(false);
    open(dialog, panel);
  });
}
