// Charts of a report: values under the mouse, series on and off, and the runs behind a point: served
// by `tether view`, they open in the viewer; else there are commands that make them again. Each chart
// is drawn when its part of the page is opened.
"use strict";

(() => {
  // Okabe and Ito, as in the figures; more series than colours differ in dashes, too.
  const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
  const isServed = "served" in document.documentElement.dataset; // by `tether view`, which says so
  const dark = matchMedia("screen and (prefers-color-scheme: dark)");
  const DASHES = [[], [6, 3], [2, 2]];
  const POINTS = ["circle", "rect", "triangle"];

  const digits = (value) => (value === null ? "-" : Number(value.toPrecision(4)).toString());

  function describe(point) {
    let text = digits(point.mean);
    if (point.low !== null) text += ` [${digits(point.low)}, ${digits(point.high)}]`;
    text += `, n = ${point.n}`;
    return point.lost > 0 ? `${text}, ${point.lost} lost` : text;
  }

  // Chart.js has no error bars.
  const intervals = {
    id: "intervals",
    beforeDatasetsDraw(chart) {
      const { ctx, scales } = chart;
      for (const { index } of chart.getSortedVisibleDatasetMetas()) {
        const dataset = chart.data.datasets[index];
        ctx.strokeStyle = dataset.borderColor;
        ctx.lineWidth = 1;
        for (const point of dataset.data) {
          if (point.low === null) continue;
          const x = scales.x.getPixelForValue(point.x);
          ctx.beginPath();
          ctx.moveTo(x, scales.y.getPixelForValue(Math.max(point.low, scales.y.min)));
          ctx.lineTo(x, scales.y.getPixelForValue(point.high));
          ctx.stroke();
        }
      }
    },
  };

  function datasetOf(series, number, chart) {
    const colours = [...COLOURS, dark.matches ? "#ffffff" : "#000000"];
    const colour = colours[number % colours.length];
    const style = Math.floor(number / colours.length) % DASHES.length;
    return {
      label: series.name || "mean",
      data: series.points
        .filter((point) => point.mean !== null)
        .map((point) => ({ ...point, y: point.mean }))
        .sort((a, b) => a.x - b.x),
      borderColor: colour,
      backgroundColor: colour,
      borderDash: DASHES[style],
      pointStyle: POINTS[style],
      pointRadius: 4,
      showLine: chart.names.length === 0,
      borderWidth: 1.5,
    };
  }

  // x is a number, or the place of a name.
  const xText = (chart, x) => chart.names[x - 1] ?? digits(x);

  const addressOf = (chart, point, seed) => `${chart.runs_at}/${point.arm}/${seed}`;
  const TAB = "tether-run"; // one for all runs

  function commandsFor(chart, point, seed) {
    const again =
      `tether sweep scenario '${chart.folder}' ${point.arm} ${seed} --out again.toml\n` +
      "tether run again.toml --view    # in the browser; or --out out/again";
    return isServed ? again : `${again}\ntether view '${chart.report}'    # this page, where a click opens a run`;
  }

  // The runs of a point, the worst first, and how to see the chosen one. Returns the worst one's address.
  function showRuns(place, chart, label, point) {
    const runs = point.runs.filter(([, value]) => value !== null).sort((a, b) => b[1] - a[1]);
    const select = document.createElement("select");
    for (const [seed, value] of runs) {
      select.add(new Option(`seed ${seed}: ${digits(value)}`, seed));
    }
    const link = Object.assign(document.createElement("a"), { textContent: "open it in the viewer", target: TAB });
    const commands = document.createElement("pre");
    const write = () => {
      link.href = addressOf(chart, point, select.value);
      commands.textContent = commandsFor(chart, point, select.value);
    };
    select.addEventListener("change", write);
    write();
    const title = document.createElement("p");
    title.textContent = `${label}, ${chart.x_label} ${xText(chart, point.x)}: ${describe(point)}. The run with `;
    title.append(select, ...(isServed ? [": ", link, ", or again:"] : [" again:"]));
    place.replaceChildren(title, commands);
    return link.href;
  }

  // Points for those who have no mouse: a list of them all, which shows the runs as a click does.
  function pointList(datasets, chart, show) {
    const list = new DocumentFragment();
    datasets.forEach(({ label, data }, series) => {
      const group = Object.assign(document.createElement("optgroup"), { label });
      data.forEach((point, index) =>
        group.append(new Option(`${chart.x_label} ${xText(chart, point.x)}: ${describe(point)}`, `${series} ${index}`)),
      );
      list.append(group);
    });
    const select = document.createElement("select");
    select.append(new Option("choose …", ""), list);
    select.addEventListener("change", () => {
      if (select.value) show(...select.value.split(" ").map(Number));
    });
    const line = Object.assign(document.createElement("label"), { className: "points", textContent: "Point " });
    line.append(select);
    return line;
  }

  function draw(figure) {
    const chart = JSON.parse(figure.querySelector("script").textContent);
    const runs = figure.querySelector(".runs");
    const style = getComputedStyle(figure);
    Chart.defaults.color = style.color;
    Chart.defaults.borderColor = style.getPropertyValue("--line");
    const axis = (text) => ({ title: { display: true, text } });
    const named = chart.names.length > 0 && {
      min: 0.5,
      max: chart.names.length + 0.5,
      ticks: { stepSize: 1, callback: (x) => chart.names[x - 1] ?? "" },
    };
    const datasets = chart.series.map((series, number) => datasetOf(series, number, chart));
    const show = (series, index) => showRuns(runs, chart, datasets[series].label, datasets[series].data[index]);
    if (!figure.querySelector(".points")) runs.before(pointList(datasets, chart, show));
    return new Chart(figure.querySelector("canvas"), {
      type: "scatter",
      data: { datasets },
      options: {
        animation: false,
        scales: {
          x: { type: "linear", reverse: chart.reversed, ...axis(chart.x_label), ...named },
          y: { type: chart.log ? "logarithmic" : "linear", beginAtZero: true, ...axis(chart.y_label) },
        },
        plugins: {
          legend: { position: "bottom", labels: { usePointStyle: true } },
          tooltip: {
            callbacks: {
              label: ({ raw, dataset }) =>
                `${dataset.label}, ${chart.x_label} ${xText(chart, raw.x)}: ${describe(raw)}`,
            },
          },
        },
        onClick: (event, [hit]) => {
          if (!hit) return;
          const address = show(hit.datasetIndex, hit.index);
          if (isServed) open(address, TAB)?.focus();
        },
      },
      plugins: [intervals],
    });
  }

  // When the system changes between light and dark, what has been drawn is drawn again.
  for (const figure of document.querySelectorAll("details.chart")) {
    let drawn = null;
    const drawIfOpen = () => {
      if (figure.open) drawn ??= draw(figure);
    };
    figure.addEventListener("toggle", drawIfOpen);
    dark.addEventListener("change", () => {
      drawn?.destroy();
      drawn = null;
      drawIfOpen();
    });
    drawIfOpen();
  }
})();
