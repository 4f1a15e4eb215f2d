// Sliders, menus and fields for whatever the server lets be set.

import { GROUP_TITLES, companions, kindOf, known, parseText, place, twin } from "./model/known_settings.js";
import { IN_EFFECT } from "./model/topics.js";

const SEND_EVERY_MS = 100;

export class Controls {
  /** `set(parameters)` sends [{name, value}...] to the server. */
  constructor(box, answer, set) {
    this.box = box;
    this.answer = answer;
    this.set = set;
    this.rows = new Map(); // name -> row
    this.waiting = new Map(); // name -> value, not sent yet
    this.both = true;
    this.shape = "";
    this.hasRelay = false; // only a relay can set a network
    this.told = new Map(); // name -> what the server says that it is
    this.parameters = new Map();
  }

  /** What the server says of each parameter. */
  describe(descriptions) {
    this.told = new Map(descriptions.map((one) => [one.name, one]));
    this.shape = "";
    this.update(this.parameters);
  }

  showRelay(hasRelay) {
    if (this.hasRelay === hasRelay) return;
    this.hasRelay = hasRelay;
    this.update(this.parameters);
  }

  /** Those that can be set and do something now. */
  isOffered(name, effective) {
    if (!this.hasRelay && name.startsWith("network.")) return false;
    if (name.startsWith("playback.") || this.told.get(name)?.can_be_set === false) return false;
    return !effective || !name.startsWith("network.") || effective.has(name);
  }

  /** Values came. */
  update(parameters) {
    this.parameters = parameters;
    const effective = parameters.has(IN_EFFECT) ? new Set(parameters.get(IN_EFFECT)) : null;
    const names = [...parameters.keys()].filter((name) => this.isOffered(name, effective));
    const shape = names.join();
    if (shape !== this.shape) {
      this.shape = shape;
      this.build(names, parameters);
    }
    for (const name of names) this.rows.get(name)?.show(parameters.get(name));
  }

  build(names, parameters) {
    this.box.replaceChildren();
    this.box.parentElement.hidden = names.length === 0;
    this.rows.clear();
    if (!names.length) return;
    const groups = new Map();
    for (const name of names) {
      const where = place(name);
      if (!groups.has(where.group)) groups.set(where.group, { main: [], more: [] });
      const isMain = where.isMain && parameters.get(name) !== undefined;
      groups.get(where.group)[isMain ? "main" : "more"].push({ name, label: where.label });
    }
    if (names.some((name) => twin(name) && parameters.has(twin(name)))) this.box.append(this.buildBoth());
    const more = document.createElement("details");
    more.id = "more-settings";
    more.append(Object.assign(document.createElement("summary"), { textContent: "More settings" }));
    for (const [group, { main, more: rest }] of groups) {
      if (main.length) this.box.append(this.buildGroup(group, main, parameters));
      if (rest.length) more.append(this.buildGroup(group, rest, parameters));
    }
    if (more.childElementCount > 1) this.box.append(more);
  }

  buildBoth() {
    const label = document.createElement("label");
    const input = Object.assign(document.createElement("input"), {
      type: "checkbox",
      checked: this.both,
      id: "both-links",
    });
    input.addEventListener("change", () => (this.both = input.checked));
    label.append(input, " both links together");
    return label;
  }

  buildGroup(group, rows, parameters) {
    const set = document.createElement("fieldset");
    set.append(
      Object.assign(document.createElement("legend"), { textContent: GROUP_TITLES[group] ?? group }),
    );
    for (const { name, label } of rows) set.append(this.buildRow(name, label, parameters.get(name)));
    return set;
  }

  buildRow(name, label, value) {
    const told = this.told.get(name);
    const kind = kindOf(value, told);
    const row = document.createElement("label");
    row.className = kind === "switch" ? "setting bool" : "setting";
    row.title = told ? `${name}: ${told.meaning}; ${told.allowed || told.kind}` : name;
    row.dataset.name = name;
    const about = known(name, told);
    row.append(
      Object.assign(document.createElement("span"), {
        textContent: about.unit ? `${label}, ${about.unit}` : label,
      }),
    );
    const inputs = this.inputsFor(name, about, kind);
    row.append(...inputs);
    this.rows.set(name, {
      show: (now) => {
        row.classList.remove("refused");
        if (inputs.includes(document.activeElement) && this.waiting.has(name)) return; // a hand is on it
        this.fill(inputs, now);
      },
      refuse: () => row.classList.add("refused"),
      fill: (now) => this.fill(inputs, now),
    });
    return row;
  }

  fill(inputs, value) {
    for (const input of inputs) {
      if (input.type === "checkbox") input.checked = value === true;
      else if (input.tagName === "SELECT") this.choose(input, value);
      else if (input !== document.activeElement || input.type === "range") {
        input.value = value === undefined ? "" : typeof value === "object" ? JSON.stringify(value) : value;
      }
    }
  }

  choose(select, value) {
    if (value !== undefined && ![...select.options].some((option) => option.value === value))
      select.append(new Option(value, value));
    select.value = value;
  }

  inputsFor(name, about, kind) {
    const make = (type, more = {}) => Object.assign(document.createElement("input"), { type, ...more });
    if (kind === "switch") {
      const box = make("checkbox");
      box.addEventListener("change", () => this.change(name, box.checked, true));
      return [box];
    }
    if (about.words) {
      const select = document.createElement("select");
      for (const word of about.words) select.append(new Option(word, word));
      select.addEventListener("change", () => this.change(name, select.value, true));
      return [select];
    }
    const isNumber = kind === "number" || kind === "whole number";
    const field = make(isNumber ? "number" : "text", isNumber ? { step: "any" } : {});
    field.addEventListener("change", () => this.change(name, parseText(kind, field.value), true));
    if (!isNumber || about.max === undefined) return [field];
    const slider = make("range", { min: about.min, max: about.max, step: about.step });
    slider.setAttribute("aria-label", name);
    slider.addEventListener("input", () => this.change(name, Number(slider.value), false));
    slider.addEventListener("change", () => this.change(name, Number(slider.value), true));
    return [slider, field];
  }

  change(name, value, isFinal) {
    if (value === undefined) return;
    const other = this.both ? twin(name) : null;
    for (const one of other && this.rows.has(other) ? [name, other] : [name]) {
      this.waiting.set(one, value);
      for (const [more, start] of companions(one, value, (key) => this.parameters.get(key)))
        this.waiting.set(more, start);
    }
    for (const [each, now] of this.waiting) this.rows.get(each)?.fill(now);
    if (isFinal) this.send();
    else this.timer ??= setTimeout(() => this.send(), SEND_EVERY_MS);
  }

  send() {
    clearTimeout(this.timer);
    this.timer = null;
    if (!this.waiting.size) return;
    this.asked = [...this.waiting.keys()];
    this.set([...this.waiting].map(([name, value]) => ({ name, value })));
    this.waiting.clear();
    this.say("", "none");
  }

  /** The server's words about the last change. */
  say(text, level) {
    this.answer.textContent = text;
    this.answer.dataset.level = level;
    if (level === "bad") for (const name of this.asked ?? []) this.rows.get(name)?.refuse();
  }
}
