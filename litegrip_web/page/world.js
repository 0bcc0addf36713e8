/* The world of a simulated gripper: an object to drag in and out, a hand at the jaws, faults. */

import { figure, isNumber } from "./format.js";

const LOOK_EVERY_MS = 500;
const PUSH_NM = 0.8;
const MOST_NM = 0.8;
const NM_PER_MM = 0.04;

export class World {
  #panel;
  #isOn = false;
  #operates = false;
  #width = null;
  #pushing = null;

  constructor(panel) {
    this.#panel = panel;
    const on = (name, act) => {
      panel.node(name).onclick = act;
    };
    on("put", () => this.onObject(true));
    on("take-away", () => this.onObject(false));
    on("fault", () => this.#do("sim.fault", { name: "overload" }));
    on("reset", () => this.#do("sim.reset"));
    for (const [name, torque] of [["push-open", -PUSH_NM], ["push-close", PUSH_NM]]) {
      const button = panel.node(name);
      const push = () => this.#push(torque);
      const letGo = () => this.#push(0);
      button.onpointerdown = push;
      button.onpointerup = button.onpointercancel = button.onpointerleave = letGo;
      button.onkeydown = (event) => {
        if ([" ", "Enter"].includes(event.key) && !event.repeat) push();
      };
      button.onkeyup = button.onblur = letGo;
    }
    setInterval(() => this.#look(), LOOK_EVERY_MS);
  }

  begin(isSimulated, operate) {
    this.#isOn = isSimulated;
    this.#operates = operate;
    this.#panel.node("world").hidden = !isSimulated;
    this.#look();
  }

  end() {
    this.#isOn = false;
  }

  /* An object is dragged in, or away. */
  onObject(isIn) {
    const node = this.#panel.node("object");
    if (!isIn) this.#do("sim.object");
    else if (node.reportValidity()) this.#do("sim.object", { width_mm: Number(node.value) });
  }

  /* A jaw is pushed by a pointer that is so many mm ahead of it, in the direction that closes. */
  onPush(mm) {
    const torque = Math.max(-MOST_NM, Math.min(MOST_NM, mm * NM_PER_MM));
    this.#push(torque);
  }

  #push(torque) {
    const rounded = Math.round(torque * 20) / 20;
    if (!this.#operates || rounded === (this.#pushing ?? 0)) return;
    this.#pushing = rounded;
    this.#do("sim.push", { torque_nm: rounded });
  }

  async #do(method, params = {}) {
    try {
      this.#show(await this.#panel.wire.call(method, params));
    } catch (error) {
      this.#panel.complain(error.message);
    }
  }

  async #look() {
    if (!this.#isOn || document.hidden || !this.#panel.wire.isUp) return;
    await this.#do("sim.get");
  }

  #show(world) {
    const { object } = world;
    this.#panel.node("object").max = Math.floor(this.#panel.travel);
    if (object) this.#width = object.width_mm;
    const tray = this.#operates ? Number(this.#panel.node("object").value) : null;
    this.#panel.jaws.setWorld(object ? this.#width : tray, object !== null, this.#operates);
    const parts = [object ? `an object of ${figure(object.width_mm, 0, "mm")}` : "no object"];
    if (isNumber(world.push_nm) && world.push_nm !== 0) {
      parts.push(`a hand ${world.push_nm > 0 ? "closes" : "opens"} with ${figure(Math.abs(world.push_nm), 1, "N·m")}`);
    }
    if (world.held) parts.push("the jaws are held fast");
    if (!world.powered) parts.push("the motor has no power");
    const how = this.#operates ? " Drag it, or a jaw." : "";
    this.#panel.node("world-text").textContent = `${parts.join("; ")}.${how}`;
  }
}
