// Manual driving: keys or a pad, each with a dead-man control. Nothing is sent unless it is held; when it is released,
// or the page loses the keyboard, zero twists are sent for a moment, then nothing.

import { fixed } from "./numbers.js";

export const TWISTS_PER_S = 20;
const ZEROS = 10;
const TURN_RADPS = 0.8;

/** The twist of keys that are down; null: the dead man is not held. Pure. */
export function twistOfKeys(keys, speed_mps) {
  if (!keys.has("Space")) return null;
  const any = (...codes) => (codes.some((code) => keys.has(code)) ? 1 : 0);
  const forward = any("KeyW", "ArrowUp") - any("KeyS", "ArrowDown");
  const left = any("KeyA", "ArrowLeft") - any("KeyD", "ArrowRight");
  return { v_mps: forward * speed_mps, omega_radps: left * TURN_RADPS };
}

/** The twist of a pad pulled to (x, y), each -1 to 1, y up. Pure. */
export function twistOfPad(x, y, speed_mps) {
  const soft = (value) => (Math.abs(value) < 0.1 ? 0 : Math.max(-1, Math.min(1, value)));
  return { v_mps: soft(y) * speed_mps, omega_radps: -soft(x) * TURN_RADPS };
}

function isTyping(target) {
  return target.closest?.("input[type=number], input[type=text], select") !== null;
}

export class Drive {
  /** `send(twist)` publishes it. */
  constructor(root, send) {
    this.root = root;
    this.send = send;
    this.keys = new Set();
    this.pad = null; // where it is pulled to
    this.zeros = 0;
    this.speed = root.querySelector("#drive-speed");
    this.state = root.querySelector("#drive-state");
    this.speed.addEventListener("input", () => {
      root.querySelector("#drive-speed-value").textContent = `${Number(this.speed.value).toFixed(1)} m/s`;
    });
    addEventListener("keydown", (event) => this.key(event, true));
    addEventListener("keyup", (event) => this.key(event, false));
    addEventListener("blur", () => this.letGo());
    document.addEventListener("visibilitychange", () => this.letGo());
    this.watchPad(root.querySelector("#pad"));
    setInterval(() => this.tick(), 1000 / TWISTS_PER_S);
  }

  get isThere() {
    return !this.root.hidden;
  }

  key(event, isDown) {
    if (!this.isThere || isTyping(event.target)) return;
    if (
      event.code !== "Space" &&
      !(this.keys.has("Space") && /^(Key[WASD]|Arrow)/.test(event.code)) &&
      isDown
    )
      return;
    if (isDown) event.preventDefault();
    if (isDown) this.keys.add(event.code);
    else this.keys.delete(event.code);
  }

  letGo() {
    this.keys.clear();
    this.pad = null;
  }

  watchPad(canvas) {
    const pull = (event) => {
      const box = canvas.getBoundingClientRect();
      this.pad = [
        ((event.clientX - box.left) / box.width) * 2 - 1,
        1 - ((event.clientY - box.top) / box.height) * 2,
      ];
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pull(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.pad) pull(event);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"])
      canvas.addEventListener(end, () => (this.pad = null));
    this.canvas = canvas;
  }

  tick() {
    if (!this.isThere) return;
    const speed = Number(this.speed.value);
    const twist = this.pad ? twistOfPad(...this.pad, speed) : twistOfKeys(this.keys, speed);
    if (twist) {
      this.zeros = ZEROS;
      this.send(twist);
      this.state.textContent = `sending ${fixed(twist.v_mps, 2)} m/s, ${fixed(twist.omega_radps, 2)} rad/s`;
    } else if (this.zeros > 0) {
      --this.zeros;
      this.send({ v_mps: 0, omega_radps: 0 });
      this.state.textContent = "dead man released: stop";
    } else {
      this.state.textContent = "dead man released: nothing is sent";
    }
    this.drawPad();
  }

  drawPad() {
    const c = this.canvas.getContext("2d");
    const style = getComputedStyle(this.canvas);
    const { width, height } = this.canvas;
    c.clearRect(0, 0, width, height);
    c.strokeStyle = style.borderTopColor;
    c.beginPath();
    c.moveTo(width / 2, 12);
    c.lineTo(width / 2, height - 12);
    c.moveTo(12, height / 2);
    c.lineTo(width - 12, height / 2);
    c.stroke();
    const [x, y] = this.pad ?? [0, 0];
    const r = Math.max(1, Math.hypot(x, y));
    c.fillStyle = style.color;
    c.globalAlpha = this.pad ? 1 : 0.5;
    c.beginPath();
    c.arc((width / 2) * (1 + (0.8 * x) / r), (height / 2) * (1 - (0.8 * y) / r), 16, 0, 7);
    c.fill();
    c.globalAlpha = 1;
  }
}
