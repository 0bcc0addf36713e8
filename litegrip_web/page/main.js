/* The page: a panel for each gripper, STOP for all of them, and dumps that are dropped onto it. */

import { showDump } from "./dump.js";
import { Panel } from "./panel.js";

const $ = (id) => document.getElementById(id);

function notice(text) {
  $("notice").textContent = text;
}

/* The secret stands behind the address, where no server and no other page sees it. */
function takeToken() {
  const given = location.hash.slice(1);
  if (given) {
    sessionStorage.setItem("token", given);
    history.replaceState(null, "", location.pathname);
  }
  return given || sessionStorage.getItem("token");
}

function start() {
  const channels = document.body.dataset.channels.split(" ");
  document.title = `LiteGrip ${channels.join(", ")}`;
  const token = takeToken();
  if (!token) {
    notice("This address lacks its secret: open the whole one that litegripd-web printed.");
    $("stop").disabled = true;
    return;
  }
  document.body.classList.toggle("several", channels.length > 1);
  const panels = channels.map((channel) => new Panel(channel, token, $("grippers")));
  const stop = () => {
    for (const panel of panels) panel.stop();
  };
  $("stop").onclick = stop;
  addEventListener(
    "keydown",
    (event) => {
      if (event.key === "Escape") stop();
    },
    true,
  );
  addEventListener("keydown", (event) => press(event, panels));
}

/* A key acts on the one gripper that this page controls. */
function press(event, panels) {
  const isTyping = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "range";
  if (isTyping || event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  if (document.querySelector("dialog[open]")) return;
  const controlled = panels.filter((panel) => panel.control.has);
  if (controlled.length === 1 && controlled[0].control.press(event.key.toLowerCase())) {
    event.preventDefault();
  }
}

addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", (event) => {
  event.preventDefault();
  const [file] = event.dataTransfer.files;
  if (file) showDump(file, $("dump"), notice);
});
$("dump-file").onchange = (event) => {
  const [file] = event.target.files;
  if (file) showDump(file, $("dump"), notice);
};

start();
