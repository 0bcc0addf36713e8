/* The jaws to scale, from above: what is measured, what is commanded, and what is between them.

   A millimetre is a unit of the drawing. In a simulated world the object can be dragged in and out,
   and the jaws pushed. */

const SVG = "http://www.w3.org/2000/svg";
const FINGER = 12;
const DEPTH = 46;
const TOP = 14;
const TRAY = 82;
const HEIGHT = 78;
const HEIGHT_WITH_TRAY = 108;

function shape(kind, attributes, parent) {
  const node = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  parent?.append(node);
  return node;
}

export class Jaws {
  /* `hands` has `onObject(isIn)` and `onPush(side, mm)`: what a pointer does in a simulated world. */
  #travel = 0;
  #nodes = {};
  #isHandy = false;
  #opening = null;

  constructor(place, hands) {
    this.svg = shape("svg", { class: "jaws", role: "img" }, place);
    this.svg.setAttribute("aria-label", "The jaws: opening unknown");
    this.hands = hands;
    this.setTravel(120);
  }

  /* Draw a gripper of another travel, in mm. */
  setTravel(travel) {
    if (travel === this.#travel) return;
    this.#travel = travel;
    const half = travel / 2 + FINGER + 4;
    this.svg.replaceChildren();
    this.#fit(HEIGHT);
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
    const tray = shape("g", { class: "tray" }, svg);
    shape("rect", { x: -half + 2, y: TRAY - 3, width: 2 * half - 4, height: 26, rx: 3 }, tray);
    const words = shape("text", { class: "scale", x: 0, y: TRAY + 12 }, tray);
    words.textContent = "drag the object between the jaws, or out of them to here";
    this.#nodes = {
      tray,
      item: shape("rect", { class: "item", y: 24, height: 28, rx: 3 }, svg),
      left: shape("rect", { class: "jaw", y: TOP, width: FINGER, height: DEPTH, rx: 2 }, svg),
      right: shape("rect", { class: "jaw", y: TOP, width: FINGER, height: DEPTH, rx: 2 }, svg),
      low: shape("path", { class: "command", d: "M0 62 l-2.5 5 h5 z" }, svg),
      high: shape("path", { class: "command", d: "M0 62 l-2.5 5 h5 z" }, svg),
    };
    this.#listen();
  }

  /* Show an opening and where it is commanded to, in mm; null for what is unknown. */
  show({ opening, command, isGrasped, isStale }) {
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
    const text = opening === null ? "unknown" : `${opening.toFixed(1)} mm`;
    const held = isGrasped ? ", something is held" : "";
    this.svg.setAttribute("aria-label", `The jaws: opening ${text}${held}`);
  }

  /* Show the object of a simulated world: its width in mm, and whether it is between the jaws. */
  setWorld(width, isIn, isHandy) {
    this.#isHandy = true;
    this.svg.classList.toggle("handy", isHandy);
    this.#fit(isHandy ? HEIGHT_WITH_TRAY : HEIGHT);
    if (this.#nodes.item.classList.contains("dragged")) return;
    this.#drawItem(width, isIn);
  }

  #fit(height) {
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
    item.setAttribute("height", isIn ? 28 : 22);
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
        move: (dx) => this.hands.onPush(side * dx),
        end: () => this.hands.onPush(0),
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
    const finish = (event) => {
      if (from === null) return;
      const [x, y] = at(event);
      const begun = from;
      from = null;
      node.classList.remove("dragged");
      end(x - begun[0], y - begun[1]);
    };
    node.addEventListener("pointerup", finish);
    node.addEventListener("pointercancel", finish);
  }
}
