/* The page: a panel for each gripper, STOP for all of them, and dumps that are dropped onto it. */

import { showDump } from "./dump.js";
import { Panel } from "./panel.js";
import { Secret } from "./proof.js";
import { onPress, Stop } from "./stop.js";
import * as theme from "./theme.js";

const QUIET = /^((NO|WEAK) MOTOR|CONTROL LOST|PUSHED OPEN|FORCE LOWERED)/;
const $ = (id) => document.getElementById(id);

/* Here is nothing to stop with: STOP and Esc say so, and what to do then. */
function withoutStop(then) {
  $("stop").classList.add("unreached");
  onStop(() => {
    $("notice").textContent = `STOP does nothing here: cut the motor's power. Then open ${then}.`;
    $("notice").dataset.stop = "failed";
  });
}

function onStop(act) {
  onPress($("stop"), act);
  addEventListener(
    "keydown",
    (event) => {
      if (event.key !== "Escape") return;
      event.preventDefault(); // a dialog stays, with what it tells
      act();
    },
    true,
  );
}

function notice(text) {
  $("notice").textContent = text;
  delete $("notice").dataset.stop;
}

function between(parts, mark) {
  return parts.flatMap((part, at) => (at ? [mark, part] : [part]));
}

function badge(alarm) {
  return Object.assign(document.createElement("span"), { textContent: alarm, className: QUIET.test(alarm) ? "" : "loud" });
}

/* The name of a gripper, which leads there. */
function way({ article, channel }) {
  const button = Object.assign(document.createElement("button"), { type: "button", textContent: channel });
  button.onclick = () => article.scrollIntoView();
  return button;
}

/* Say in the bar, which is always in sight, what is wrong with each gripper; what all have is said once. The loud
   comes first, whosever it is: there may be no room for all of it. */
function showAlarms(panels) {
  const isShared = (alarm) => panels.length > 1 && panels.every(({ alarms }) => alarms.includes(alarm));
  const told = []; // of whom, and what
  const tell = (whose, alarms) => {
    if (told.at(-1)?.whose === whose) told.at(-1).alarms.push(...alarms);
    else if (alarms.length) told.push({ whose, alarms });
  };
  for (const isQuiet of [false, true]) {
    const those = (panel, ofAll) => panel.alarms.filter((one) => QUIET.test(one) === isQuiet && isShared(one) === ofAll);
    for (const panel of panels) tell(panel, those(panel, false));
    tell(null, those(panels[0], true));
  }
  const name = (panel) => (panels.length === 1 ? [] : [panel === null ? "all" : way(panel), ": "]);
  const lines = told.map(({ whose, alarms }) => [...name(whose), ...between(alarms.map(badge), ", ")]);
  $("alarm").replaceChildren(...between(lines, "; ").flat());
  $("alarm").hidden = told.length === 0;
  $("stop").classList.toggle("unreached", panels.every(({ alarms, state }) => alarms.length && !state));
}

/* The secret stands behind the address, where no server sees it. From here on it is in memory alone. */
function takeToken() {
  const token = location.hash.slice(1);
  if (token) history.replaceState(null, "", location.pathname);
  return token;
}

function start() {
  const channels = document.body.dataset.channels.split(" ");
  document.title = `LiteGrip ${channels.join(", ")}`;
  const token = takeToken();
  // The whole address, opened where the page is shown already, loads nothing by itself.
  addEventListener("hashchange", () => location.hash && location.reload());
  if (!token) {
    withoutStop("the whole address again");
    $("grippers").append($("secretless").content.cloneNode(true));
    $("unit-address").textContent = `echo "${location.origin}/#$(cat /run/litegripd-web/token)"`;
    return;
  }
  if (!isSecureContext) {
    const then = "the page at 127.0.0.1 or localhost, or with TLS";
    notice(`Browsers have no cryptography for this address: open ${then}.`);
    withoutStop(then);
    return;
  }
  $("whole").hidden = false;
  $("copy").onclick = () => copy(`${location.origin}/#${token}`);
  document.body.classList.toggle("several", channels.length > 1);
  const secret = new Secret(token);
  const panels = channels.map((channel) => new Panel(channel, secret, $("grippers")));
  for (const panel of panels) {
    panel.addEventListener("alarms", () => showAlarms(panels));
    panel.addEventListener("state", () => ($("brief").textContent = panels.map(({ brief }) => brief).join("; ")));
  }
  const stop = new Stop(panels, $("notice"), { tellsAll: true });
  onStop(() => stop.press());
  addEventListener("keydown", (event) => press(event, panels));
  addEventListener("beforeunload", (event) => {
    if (panels.some(({ control }) => control.isRecording)) event.preventDefault(); // it would be broken off
  });
  const focus = ({ target }) => {
    const article = target.closest?.(".gripper");
    if (!article) return;
    for (const panel of panels) panel.article.classList.toggle("focused", panel.article === article);
  };
  addEventListener("focusin", focus);
  addEventListener("pointerdown", focus);
  panels[0].article.classList.add("focused");
}

/* Copy the address for a bookmark, which the next owner of the port does not see until it is opened. */
async function copy(address) {
  try {
    await navigator.clipboard.writeText(address);
    $("copied").textContent = "Copied: make a bookmark of it. It is good as long as litegripd-web keeps this secret.";
  } catch (error) {
    $("copied").textContent = `Not copied: ${error.message}`;
  }
}

/* A key acts on the gripper that was used last, and on no other, even if that one can do nothing now. */
function press(event, panels) {
  const isTyping = /^(INPUT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "range";
  if (isTyping || event.ctrlKey || event.metaKey || event.altKey || event.shiftKey || event.repeat) return;
  if (document.querySelector("dialog[open]")) return;
  const panel = panels.find(({ article }) => article.classList.contains("focused"));
  if (panel.control.press(event.key.toLowerCase())) event.preventDefault();
}

/* A button that was clicked does not keep the focus: a key that is pressed later, to scroll say, would press it again. */
addEventListener("click", ({ target, detail }) => detail && target.closest("main button")?.blur(), true);

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

theme.begin($("theme"));
start();
