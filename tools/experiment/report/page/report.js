// Charts of a report: values under the mouse, series on and off, and the command that makes the
// run behind a point again. Each chart is drawn when its part of the page is opened.
"use strict";

(() => {
  // Okabe and Ito, as in the figures; more series than colours differ in dashes, too.
  const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"];
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
    const colour = COLOURS[number % COLOURS.length];
    const style = Math.floor(number / COLOURS.length) % DASHES.length;
    return {
      label: chart.y ? `${chart.y} ${series.name}` : series.name || "mean",
      data: series.points
        .filter((point) => point.mean !== null)
        .map((point) => ({ ...point, y: point.mean }))
        .sort((a, b) => a.x - b.x),
      borderColor: colour,
      backgroundColor: colour,
      borderDash: DASHES[style],
      pointStyle: POINTS[style],
      pointRadius: 4,
      showLine: true,
      borderWidth: 1.5,
    };
  }

  // The runs of a point, the worst first, and how to make the chosen one again.
  function showRuns(place, chart, label, point) {
    const runs = point.runs.filter(([, value]) => value !== null).sort((a, b) => b[1] - a[1]);
    const select = document.createElement("select");
    for (const [seed, value] of runs) {
      select.add(new Option(`seed ${seed}: ${digits(value)}`, seed));
    }
    const command = document.createElement("pre");
    const write = () => {
      command.textContent =
        `tether sweep scenario '${chart.folder}' ${point.arm} ${select.value} --out again.toml\n` +
        "tether run again.toml --view    # in the browser; or --out out/again";
    };
    select.addEventListener("change", write);
    write();
    const title = document.createElement("p");
    title.textContent = `${label}, ${chart.x_label} ${digits(point.x)}: ${describe(point)}. The run with `;
    title.append(select, " again:");
    place.replaceChildren(title, command);
  }

  function draw(figure) {
    const chart = JSON.parse(figure.querySelector("script").textContent);
    const runs = figure.querySelector(".runs");
    const axis = (text) => ({ title: { display: true, text } });
    new Chart(figure.querySelector("canvas"), {
      type: "scatter",
      data: { datasets: chart.series.map((series, number) => datasetOf(series, number, chart)) },
      options: {
        animation: false,
        scales: {
          x: { type: "linear", reverse: chart.reversed, ...axis(chart.x_label) },
          y: { type: chart.log ? "logarithmic" : "linear", beginAtZero: true, ...axis(chart.y_label) },
        },
        plugins: {
          legend: { position: "bottom", labels: { usePointStyle: true } },
          tooltip: {
            callbacks: {
              label: ({ raw, dataset }) =>
                `${dataset.label}, ${chart.x_label} ${digits(raw.x)}: ${describe(raw)}`,
            },
          },
        },
        onClick: (event, [hit], drawn) => {
          if (!hit) return;
          const dataset = drawn.data.datasets[hit.datasetIndex];
          showRuns(runs, chart, dataset.label, dataset.data[hit.index]);
        },
      },
      plugins: [intervals],
    });
  }

  for (const figure of document.querySelectorAll("details.chart")) {
    if (figure.open) draw(figure);
    else figure.addEventListener("toggle", () => draw(figure), { once: true });
  }
})();
