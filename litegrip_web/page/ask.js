/* A question before something of the user's is lost. */

import { open } from "./dialog.js";

/* Ask; return whether the answer was `yes`, the words on that button. */
export function ask(text, yes) {
  const dialog = document.getElementById("ask");
  document.getElementById("ask-text").textContent = text;
  document.getElementById("ask-yes").textContent = yes;
  return new Promise((resolve) => {
    const end = (answer) => {
      dialog.close();
      resolve(answer);
    };
    document.getElementById("ask-yes").onclick = () => end(true);
    document.getElementById("ask-no").onclick = () => end(false);
    open(dialog);
  });
}
