// All channels with rate, loss and jitter, and the fields of one message: lcm-spy in the browser.

import { fixed } from "./numbers.js";

const COLUMNS = [
  ["channel", (row) => row.topic],
  ["type", (row) => String(row.schema).replace("tether.", "")],
  ["messages", (row, s) => s.count],
  ["Hz", (row, s) => number(s.rate_hz, 2)],
  ["lost, 10 s", (row, s) => (s.missed > 0 ? `${number(100 * s.loss, 1)} %` : "0 %")],
  ["jitter p50, ms", (row, s) => number(1000 * s.p50_s, 2)],
  ["jitter p99, ms", (row, s) => number(1000 * s.p99_s, 2)],
  ["kB/s (JSON)", (row, s) => number(s.kB_per_s, 2)],
  ["last", (row, s) => (Number.isFinite(s.age_s) ? `${number(s.age_s, 1)} s ago` : "–")],
];

function number(value, digits) {
  return Number.isFinite(value) ? fixed(value, digits) : "–";
}

/** A field's value as text: long lists are cut. */
export function fieldText(value) {
  if (Array.isArray(value)) {
    const head = value.slice(0, 12).map(fieldText).join(", ");
    return value.length > 12 ? `${head}, … (${value.length})` : head;
  }
  if (value !== null && typeof value === "object") return JSON.stringify(value).slice(0, 400);
  return String(value);
}

export class ChannelTable {
  constructor(panel) {
    this.panel = panel;
    this.body = panel.querySelector("#table tbody");
    this.message = panel.querySelector("#message");
    this.count = panel.querySelector("#channel-count");
    this.rows = new Map();
    this.selected = null;
    const head = panel.querySelector("#table thead").insertRow();
    for (const [title] of COLUMNS)
      head.append(Object.assign(document.createElement("th"), { textContent: title }));
  }

  select(topic) {
    this.selected = this.selected === topic ? null : topic;
    this.body
      .querySelectorAll("tr")
      .forEach((row) => row.setAttribute("aria-selected", row.dataset.topic === this.selected));
    this.message.hidden = this.selected === null;
  }

  row(topic) {
    let row = this.rows.get(topic);
    if (row) return row;
    const after = [...this.rows.keys()].filter((other) => other > topic).sort()[0];
    row = document.createElement("tr");
    row.dataset.topic = topic;
    row.tabIndex = 0;
    for (let i = 0; i < COLUMNS.length; ++i) row.append(document.createElement("td"));
    row.addEventListener("click", () => this.select(topic));
    row.addEventListener("keydown", (event) => event.key === "Enter" && this.select(topic));
    this.body.insertBefore(row, after ? this.rows.get(after) : null);
    this.rows.set(topic, row);
    return row;
  }

  /** `stamp_s`: the time by the messages' stamps. A few times a second is enough. */
  update(channels, stamp_s) {
    this.count.textContent = `(${channels.size})`;
    if (!this.panel.open) return;
    for (const channel of channels.values()) {
      const summary = channel.summary(stamp_s);
      const cells = this.row(channel.topic).cells;
      COLUMNS.forEach(([, text], i) => {
        const value = String(text(channel, summary));
        if (cells[i].textContent !== value) cells[i].textContent = value;
      });
    }
    this.showMessage(channels.get(this.selected));
  }

  showMessage(channel) {
    if (!channel?.latest) return;
    this.message.querySelector("h3").textContent = `${channel.topic}, newest message`;
    const body = this.message.querySelector("tbody");
    const names = Object.keys(channel.latest);
    while (body.rows.length > names.length) body.deleteRow(-1);
    while (body.rows.length < names.length) {
      const row = body.insertRow();
      row.insertCell();
      row.insertCell();
    }
    names.forEach((name, i) => {
      body.rows[i].cells[0].textContent = name;
      body.rows[i].cells[1].textContent = fieldText(channel.latest[name]);
    });
  }
}
