// Scrolling plots of the last seconds, by Chart.js (a plain script: `Chart` is global).

import { PLOTTED_S } from "../model/model.js";
import { colour, onTheme } from "./theme.js";

const TICK_S = 5;

const PLOTS = [
  {
    title: "Error",
    unit: "m",
    min: 0,
    lines: [
      { name: "now", column: "error_m", colour: "truth" },
      { name: "mean ε", column: "epsilon_m", colour: "path", dash: [6, 4] },
    ],
  },
  {
    title: "Age of information",
    unit: "s",
    min: 0,
    lines: [{ name: "of the controller's newest pose", column: "age_s", colour: "newest" }],
  },
  {
    title: "Speed",
    unit: "m/s",
    lines: [
      { name: "sent", column: "v_sent_mps", colour: "predicted", dash: [6, 4], stepped: true },
      { name: "driven", column: "v_mps", colour: "truth" },
    ],
  },
  {
    title: "Yaw rate",
    unit: "rad/s",
    lines: [
      { name: "sent", column: "omega_sent_radps", colour: "predicted", dash: [6, 4], stepped: true },
      { name: "driven", column: "omega_radps", colour: "truth" },
    ],
  },
  {
    title: "Packets that get through",
    unit: "share, 5 s",
    min: 0,
    max: 1,
    lines: [
      { name: "uplink", column: "uplink_prr", colour: "truth" },
      { name: "downlink", column: "downlink_prr", colour: "newest", dash: [6, 4] },
    ],
  },
  {
    title: "Arrivals",
    unit: "per s",
    min: 0,
    lines: [
      { name: "poses", column: "uplink_per_s", colour: "truth" },
      { name: "commands", column: "downlink_per_s", colour: "newest", dash: [6, 4] },
    ],
  },
];

function points(series, column) {
  const values = series.columns[column];
  return series.time_s.map((time_s, i) => ({ x: time_s, y: values[i] === null ? NaN : values[i] }));
}

/** A number for an axis: as many digits as its step needs. */
function tick(value) {
  return Number(value.toPrecision(6)).toString();
}

/** Times at multiples of five seconds, which move with the plot. */
function wholeTicks(scale) {
  scale.ticks = [];
  for (let t = Math.ceil(scale.min / TICK_S) * TICK_S; t <= scale.max; t += TICK_S)
    scale.ticks.push({ value: t });
}

export class Plots {
  constructor(panel) {
    this.panel = panel;
    this.next = 0;
    this.plots = PLOTS.map((plot) => this.build(plot));
    onTheme(() => this.plots.forEach((plot) => this.dress(plot)));
  }

  build(plot) {
    const box = document.createElement("div");
    box.className = "plot";
    const title = document.createElement("h3");
    title.append(`${plot.title}, ${plot.unit}`);
    const keys = plot.lines.map((line) => {
      const key = document.createElement("span");
      key.className = line.dash ? "key dashed" : "key";
      key.textContent = line.name;
      title.append(key);
      return key;
    });
    const frame = document.createElement("div");
    frame.className = "box";
    const canvas = document.createElement("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${plot.title} over time`);
    frame.append(canvas);
    box.append(title, frame);
    this.panel.append(box);
    const chart = new Chart(canvas, {
      type: "line",
      data: {
        datasets: plot.lines.map((line) => ({
          data: [],
          borderDash: line.dash,
          stepped: line.stepped,
          pointRadius: 0,
          borderWidth: 2.2,
          borderJoinStyle: "round",
          clip: 3,
          order: line.dash ? 0 : 1, // dashes above: both are seen where they are equal
        })),
      },
      options: {
        animation: false,
        parsing: false,
        normalized: true,
        maintainAspectRatio: false,
        events: [],
        spanGaps: false,
        plugins: { legend: { display: false }, tooltip: { enabled: false } },
        scales: {
          x: {
            type: "linear",
            min: 0,
            max: PLOTTED_S,
            ticks: { maxRotation: 0, autoSkip: false, callback: (t) => `${tick(t)} s` },
            afterBuildTicks: wholeTicks,
          },
          y: {
            min: plot.min,
            max: plot.max,
            suggestedMin: 0,
            suggestedMax: 0.1,
            ticks: { maxTicksLimit: 5, callback: tick },
            afterFit: (scale) => (scale.width = Math.max(scale.width, 46)), // so that their times stand in line
          },
        },
      },
    });
    const built = { plot, keys, chart };
    this.dress(built);
    return built;
  }

  dress({ plot, keys, chart }) {
    plot.lines.forEach((line, i) => {
      chart.data.datasets[i].borderColor = colour(line.colour);
      keys[i].style.setProperty("--stroke", colour(line.colour));
    });
    for (const scale of Object.values(chart.options.scales)) {
      scale.grid = { color: colour("grid"), borderColor: colour("line"), tickColor: colour("line") };
      scale.ticks.color = colour("quiet");
      scale.ticks.font = { size: 12 };
    }
    chart.update("none");
  }

  /** One plot per picture, in turn: all six in one take 9 ms or more. */
  draw(series, now_s) {
    if (document.body.classList.contains("stage")) return;
    const { plot, chart } = this.plots[this.next];
    this.next = (this.next + 1) % this.plots.length;
    plot.lines.forEach((line, i) => (chart.data.datasets[i].data = points(series, line.column)));
    chart.options.scales.x.min = Math.max(0, now_s - PLOTTED_S);
    chart.options.scales.x.max = Math.max(PLOTTED_S, now_s);
    chart.update("none");
  }
}
