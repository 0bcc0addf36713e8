/* What went wrong, until somebody has read it. */

const MOST = 5;

export function toast(text) {
  const list = document.getElementById("toasts");
  for (const old of list.children) if (old.dataset.text === text) old.remove();
  const line = document.createElement("li");
  line.dataset.text = text;
  const words = document.createElement("span");
  words.textContent = `${new Date().toLocaleTimeString("en-GB")}  ${text}`;
  const close = document.createElement("button");
  close.type = "button";
  close.textContent = "Read";
  close.onclick = () => line.remove();
  line.append(words, close);
  list.append(line);
  while (list.children.length > MOST) list.firstChild.remove();
}
