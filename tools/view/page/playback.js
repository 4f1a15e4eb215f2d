// Play, pause, speed and the scrub bar of a log.

import { PLAYBACK } from "./model/topics.js";

export class PlaybackBar {
  constructor(root, set) {
    this.root = root;
    this.set = (name, value) => set([{ name, value }]);
    this.find = (id) => root.querySelector(`#${id}`);
    this.isHeld = false;
    this.playing = false;
    this.canJump = true;
    const scrub = this.find("scrub");
    scrub.addEventListener("input", () => {
      this.isHeld = true;
      this.say(Number(scrub.value));
      this.timer ??= setTimeout(() => {
        this.timer = null;
        this.set(PLAYBACK.position, Number(scrub.value));
      }, 60);
    });
    scrub.addEventListener("change", () => {
      this.set(PLAYBACK.position, Number(scrub.value));
      this.isHeld = false;
    });
    this.find("play").addEventListener("click", () => this.toggle());
    const speed = this.find("speed");
    speed.addEventListener("change", () => this.set(PLAYBACK.speed, Number(speed.value)));
  }

  get isThere() {
    return !this.root.hidden;
  }

  toggle() {
    this.set(PLAYBACK.playing, !this.playing);
  }

  /** What the server says of each parameter: of a run that is being computed only the present is known. */
  describe(descriptions) {
    const told = descriptions.find(({ name }) => name === PLAYBACK.position);
    this.canJump = told?.can_be_set !== false;
    const scrub = this.find("scrub");
    scrub.disabled = !this.canJump;
    scrub.title = this.canJump
      ? ""
      : "This run is being computed: its time cannot be set. Its log can be scrubbed.";
  }

  step(seconds) {
    if (!this.canJump) return;
    this.set(PLAYBACK.position, this.position + seconds);
  }

  update(parameters) {
    const end = parameters.get(PLAYBACK.end);
    this.root.hidden = !Number.isFinite(end);
    if (this.root.hidden) return;
    const scrub = this.find("scrub");
    this.start = parameters.get(PLAYBACK.start) ?? 0;
    scrub.min = this.start;
    scrub.max = end;
    this.playing = parameters.get(PLAYBACK.playing) === true;
    this.find("play").textContent = this.playing ? "❚❚" : "▶";
    this.find("play").setAttribute("aria-label", this.playing ? "pause" : "play");
    const speed = String(parameters.get(PLAYBACK.speed) ?? 1);
    const menu = this.find("speed");
    if (![...menu.options].some((option) => option.value === speed))
      menu.append(new Option(`${speed}×`, speed));
    menu.value = speed;
    this.speed = Number(speed);
    const position = parameters.get(PLAYBACK.position);
    if (!Number.isFinite(position) || position === this.told) return;
    this.told = position;
    this.told_s = performance.now() / 1000;
    this.moveTo(position);
  }

  /** Goes on by itself between the server's words. */
  run(heard_s) {
    if (!this.isThere || !this.playing || this.told === undefined) return;
    this.moveTo(this.told + (heard_s - this.told_s) * this.speed);
  }

  moveTo(position) {
    this.position = Math.min(Number(this.find("scrub").max), Math.max(this.start, position));
    if (this.isHeld) return;
    this.find("scrub").value = this.position;
    this.say(this.position);
  }

  say(position) {
    const { min, max } = this.find("scrub");
    this.find("scrub-time").textContent = `${(position - min).toFixed(1)} / ${(max - min).toFixed(1)} s`;
  }
}
