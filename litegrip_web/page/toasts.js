/* What went wrong, in the bar: until somebody has read it, or it is over. The newest of the worst is seen, a click
   shows all. */

import { time } from "./format.js";

const MOST = 5;
const RANKS = ["", "trouble", "loss", "unstopped", "away", "failed"]; // the worst last
const list = document.getElementById("toasts");
list.onclick = () => list.classList.toggle("whole");

/* Say `text`, in the place of what was said `about` the same; a state ends it for which `isOver`. It is of `atS`, in
   seconds of the time of day (null: no time is said), and `onRead` is called once it has been read (null: it is said
   as long as it is so). What is no gripper's has no channel. What is of a higher rank is seen in the place of what is
   of a lower one. What `outlives` the connection asks for no act that needs one. */
export function toast(channel, text, about, options) {
  const { isOver = () => false, atS = Date.now() / 1000, onRead = () => {}, rank = "", outlives = false } = options;
  const line = document.createElement("li");
  const words = document.createElement("span");
  const whose = channel !== null && document.body.classList.contains("several") ? `${channel}: ` : "";
  const when = document.createElement("time");
  when.textContent = atS === null ? "" : `${time(atS)}  `;
  words.append(when, `${whose}${text}`);
  const close = document.createElement("button");
  close.type = "button";
  close.textContent = "Read";
  close.onclick = (event) => {
    event.stopPropagation();
    remove((one) => one === line);
    onRead();
  };
  line.append(words, ...(onRead === null ? [] : [close]));
  Object.assign(line, { channel, about, isOver, outlives });
  remove((one) => one.channel === channel && one.about === about);
  line.dataset.rank = rank;
  const isWorse = (one) => RANKS.indexOf(one.dataset.rank) > RANKS.indexOf(rank);
  list.insertBefore(line, [...list.children].find(isWorse) ?? null);
  remove((one) => [...list.children].indexOf(one) < list.children.length - MOST);
}

/* Say no more what was said about something: it is tried again, or has been put right. */
export function untoast(channel, about) {
  remove((one) => one.channel === channel && one.about === about);
}

/* Say no more what a state shows to be over. */
export function sweep(channel, state) {
  remove((one) => one.channel === channel && one.isOver(state));
}

/* While a gripper is away, say nothing that advises what nobody can do then; say it again afterwards. */
export function suspend(channel, isAway) {
  for (const line of list.children) if (line.channel === channel && !line.outlives) line.hidden = isAway;
  count();
}

function remove(isGone) {
  for (const line of [...list.children].filter(isGone)) line.remove();
  count();
}

function count() {
  const more = [...list.children].filter(({ hidden }) => !hidden).length - 1;
  list.dataset.more = more > 0 ? `+${more}` : "";
  if (more < 0) list.classList.remove("whole");
}
