/* The jaws to scale, from above: what is measured, what is commanded, and what is between them.

   A millimetre is a unit of the drawing. Nothing is drawn before the daemon has told the travel.
   In a simulated world the object can be dragged in and out, and the jaws pushed. */

import { figure } from "./format.js";

const SVG = "http://www.w3.org/2000/svg";
const FINGER = 12;
const DEPTH = 46;
const TOP = 14;
const SAID = 80;
const TRAY = 91;
const HEIGHT = 87;
const HEIGHT_WITH_TRAY = 106;

function shape(kind, attributes, parent) {
  const node = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  parent?.append(node);
  return node;
}

export class Jaws {
  /* `hands` has `onObject(isIn)` and `onJaw(mm)`: what a pointer does in a simulated world. */
  #travel = null;
  #work = null;
  #nodes = {};
  #isHandy = false;
  #opening = null;

  constructor(place, hands) {
    this.svg = shape("svg", { class: "jaws", role: "img" }, place);
    this.svg.setAttribute("aria-label", "The jaws: opening unknown");
    this.hands = hands;
  }

  /* Draw a gripper of another travel, in mm. `work` is where open goes to, null for the stop. */
  setScale(travel, work) {
    if (travel === this.#travel && work === this.#work) return;
    this.#travel = travel;
    this.#work = work;
    const half = travel / 2 + FINGER + 4;
    this.svg.replaceChildren();
    this.#fit();
    const svg = this.svg;
    shape("rect", { class: "rail", x: -half + 2, y: 2, width: 2 * half - 4, height: 8, rx: 2 }, svg);
    for (let mm = 0; mm <= travel; mm += 20) {
      for (const side of mm ? [-1, 1] : [1]) {
        shape("line", { class: "tick", x1: (side * mm) / 2, x2: (side * mm) / 2, y1: 66, y2: 69 }, svg);
      }
      if (mm % 40) continue;
      const label = shape("text", { class: "scale", x: mm / 2, y: 75 }, svg);
      label.textContent = mm;
    }
    if (work !== null) this.#drawWork(work);
    const tray = shape("g", { class: "tray" }, svg);
    shape("rect", { x: -half + 2, y: TRAY - 3, width: 2 * half - 4, height: 16, rx: 3 }, tray);
    for (const [side, words] of [[-1, "drag it in"], [1, "or out"]]) {
      const x = side * (half - 17); // beside an object that lies there
      shape("text", { class: "scale", x, y: TRAY + 7 }, tray).textContent = words;
    }
    this.#nodes = {
      tray,
      item: shape("rect", { class: "item", y: 24, height: 28, rx: 3 }, svg),
      left: shape("rect", { class: "jaw", y: TOP, width: FINGER, height: DEPTH, rx: 2 }, svg),
      right: shape("rect", { class: "jaw", y: TOP, width: FINGER, height: DEPTH, rx: 2 }, svg),
      low: shape("path", { class: "command", d: "M0 62 l-2.5 5 h5 z" }, svg),
      high: shape("path", { class: "command", d: "M0 62 l-2.5 5 h5 z" }, svg),
      span: shape("path", { class: "span" }, svg),
      said: shape("text", { class: "said", x: 0, y: SAID + 6.5 }, svg),
    };
    this.#listen();
  }

  #drawWork(work) {
    const mark = shape("g", { class: "work" }, this.svg);
    const goes = `Open goes to ${work} mm, the work stroke, not to the stop`;
    shape("title", {}, mark).textContent = goes;
    for (const x of [-work / 2, work / 2]) shape("line", { x1: x, x2: x, y1: 10, y2: 69 }, mark);
    const label = shape("text", { class: "scale", x: -work / 2, y: 75 }, mark);
    label.textContent = `Open: ${work} mm`;
  }

  /* Show an opening and where it is commanded to, in mm; null for what is unknown. */
  show({ opening, command, isGrasped, isStale }) {
    if (this.#travel === null) return;
    this.#opening = opening;
    const { left, right, low, high } = this.#nodes;
    const known = opening ?? this.#travel;
    left.setAttribute("x", -known / 2 - FINGER);
    right.setAttribute("x", known / 2);
    for (const jaw of [left, right]) {
      jaw.classList.toggle("unknown", opening === null || isStale);
      jaw.classList.toggle("holds", isGrasped);
    }
    for (const [mark, side] of [[low, -1], [high, 1]]) {
      mark.style.display = command === null ? "none" : "";
      if (command !== null) mark.setAttribute("transform", `translate(${(side * command) / 2} 0)`);
    }
    if (!this.#isHandy) this.#drawItem(isGrasped ? opening : null, true);
    this.#say(opening, isStale);
    const text = opening === null ? "unknown" : figure(opening, 1, "mm");
    const held = isGrasped ? `, something ${isStale ? "was" : "is"} held` : "";
    const work = this.#work === null ? "" : `, open goes to ${this.#work} mm`;
    this.svg.setAttribute("aria-label", `The jaws: opening ${text}${held}${work}`);
  }

  /* Say the opening at the ruler, as a drawing does: from jaw to jaw. */
  #say(opening, isStale) {
    const { span, said } = this.#nodes;
    const half = (opening ?? 0) / 2;
    span.setAttribute("d", `M${-half} ${SAID - 2} v4 m0 -2 h${2 * half} m0 -2 v4`);
    span.style.display = opening === null ? "none" : "";
    said.textContent = figure(opening, 1, "mm");
    for (const node of [span, said]) node.classList.toggle("unknown", opening === null || isStale);
  }

  /* Show the object of a simulated world: its width in mm, and whether it is between the jaws. */
  setWorld(width, isIn, isHandy) {
    this.#isHandy = true;
    this.svg.classList.toggle("handy", isHandy);
    this.#fit();
    if (this.#nodes.item.classList.contains("dragged")) return;
    this.#drawItem(width, isIn);
  }

  #fit() {
    const height = this.svg.classList.contains("handy") ? HEIGHT_WITH_TRAY : HEIGHT;
    const half = this.#travel / 2 + FINGER + 4;
    this.svg.setAttribute("viewBox", `${-half} 0 ${2 * half} ${height}`);
  }

  #drawItem(width, isIn) {
    const { item } = this.#nodes;
    item.style.display = width === null ? "none" : "";
    if (width === null) return;
    const shown = isIn && this.#opening !== null ? Math.min(width, this.#opening) : width;
    item.setAttribute("x", -shown / 2);
    item.setAttribute("width", Math.max(shown, 0.5));
    item.setAttribute("y", isIn ? 24 : TRAY - 1);
    item.setAttribute("height", isIn ? 28 : 12);
    item.setAttribute("transform", "");
  }

  #listen() {
    const { item, left, right } = this.#nodes;
    this.#drag(item, {
      move: (_dx, dy) => item.setAttribute("transform", `translate(0 ${dy})`),
      end: (_dx, dy) => {
        item.setAttribute("transform", "");
        if (Math.abs(dy) > 20) this.hands.onObject(dy < 0);
      },
    });
    for (const [jaw, side] of [[left, 1], [right, -1]]) {
      this.#drag(jaw, {
        move: (dx) => this.hands.onJaw(side * dx),
        end: () => this.hands.onJaw(null),
      });
    }
  }

  /* Follow a pointer that drags `node`: how far, in mm. */
  #drag(node, { move, end }) {
    let from = null;
    const at = (event) => {
      const point = new DOMPoint(event.clientX, event.clientY);
      const inside = point.matrixTransform(this.svg.getScreenCTM().inverse());
      return [inside.x, inside.y];
    };
    node.addEventListener("pointerdown", (event) => {
      if (!this.svg.classList.contains("handy")) return;
      from = at(event);
      node.setPointerCapture(event.pointerId);
      node.classList.add("dragged");
      event.preventDefault();
    });
    node.addEventListener("pointermove", (event) => {
      if (from === null) return;
      const [x, y] = at(event);
      move(x - from[0], y - from[1]);
    });
    const finish = (x, y) => {
      const begun = from;
      from = null;
      node.classList.remove("dragged");
      end(x - begun[0], y - begun[1]);
    };
    node.addEventListener("pointerup", (event) => from !== null && finish(...at(event)));
    node.addEventListener("pointercancel", () => from !== null && finish(...from)); // it is where it was
  }
}
