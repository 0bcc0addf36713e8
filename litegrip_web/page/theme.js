/* Light or dark: as the system has it, until somebody chooses. */

const KEY = "theme";
const system = matchMedia("(prefers-color-scheme: dark)");

function show() {
  const chosen = localStorage.getItem(KEY);
  document.documentElement.dataset.theme = chosen ?? (system.matches ? "dark" : "light");
  dispatchEvent(new Event("theme"));
}

export function begin(button) {
  system.addEventListener("change", show);
  button.onclick = () => {
    const other = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    const isSystems = (other === "dark") === system.matches;
    if (isSystems) localStorage.removeItem(KEY);
    else localStorage.setItem(KEY, other);
    show();
  };
  show();
}
