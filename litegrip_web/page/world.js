/* The world of a simulated gripper: an object to drag in and out, a hand at the jaws, faults. */

import { numberIn, typed } from "./fields.js";
import { figure, isNumber } from "./format.js";
import { Hand } from "./hand.js";

const LOOK_EVERY_MS = 500;
const PUSH_NM = 0.8;

export class World {
  #panel;
  #isOn = false;
  #operates = false;
  #width = null;
  #hand = null;
  #isPushing = false;
  #next = null;

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
      let isPushing = false;
      const push = () => {
        isPushing = true;
        this.#push(torque);
      };
      const letGo = () => {
        if (isPushing) this.#push(0);
        isPushing = false;
      };
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
    const world = this.#panel.node("world");
    world.hidden = !isSimulated;
    world.disabled = false;
    this.#look();
  }

  end() {
    this.#isOn = false;
    this.#letGo();
    this.#panel.node("world").disabled = true;
  }

  /* An object is dragged in, or away. */
  onObject(isIn) {
    if (!isIn) return void this.#do("sim.object");
    const width = numberIn(this.#panel.node("object"));
    if (width !== null) this.#do("sim.object", { width_mm: width });
  }

  /* A jaw is led by a pointer that has closed it by so many mm since it took it; null: let go. */
  onJaw(mm) {
    if (mm === null) this.#letGo();
    else if (this.#operates) {
      this.#hand ??= this.#take();
      this.#hand?.move(mm);
    }
  }

  /* What a state says of the jaws that are led. */
  show(state) {
    this.#hand?.see(state.opening_mm, this.#panel.wire.age(state.monotonic_s));
  }

  #take() {
    const { opening_mm: opening } = this.#panel.state ?? {};
    const mmPerRad = this.#panel.mmPerRad;
    if (!isNumber(opening) || mmPerRad === null) return null;
    return new Hand(opening, mmPerRad, (torque, damping) => this.#push(torque, damping));
  }

  #letGo() {
    this.#hand?.letGo();
    this.#hand = null;
  }

  /* One push is on its way at a time, so that a slow link is not filled with old ones. */
  async #push(torque, damping = 0) {
    this.#next = { torque_nm: torque, damping_nm_s_rad: damping };
    if (this.#isPushing) return;
    this.#isPushing = true;
    while (this.#next !== null && this.#operates && this.#panel.wire.isUp) {
      const params = this.#next;
      this.#next = null;
      await this.#do("sim.push", params);
    }
    this.#isPushing = false;
  }

  async #do(method, params = {}) {
    try {
      this.#show(await this.#panel.wire.call(method, params));
      this.#panel.forgive(method);
    } catch (error) {
      this.#panel.complain(error.message, method);
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
    const width = this.#operates ? typed(this.#panel.node("object")) : null;
    const tray = isNumber(width) ? width : null;
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
