/* Opening and force over time: of the last minute as it goes, or of a dump as it was. */

import uPlot from "./vendor/uPlot.js";

export const WINDOW_S = 60;
const GAP_S = 1;
const LEAST_SPAN = { mm: 10, N: 5 };
const HEIGHT = 150;

const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/* A range that fits the values, and is never so small that noise looks like motion. */
function range(unit) {
  return (_plot, low, high) => {
    if (low == null) return [0, LEAST_SPAN[unit]];
    const missing = Math.max(0, LEAST_SPAN[unit] - (high - low));
    const margin = 0.08 * Math.max(high - low, LEAST_SPAN[unit]);
    return [low - missing / 2 - margin, high + missing / 2 + margin];
  };
}

function axis(label) {
  return {
    stroke: () => color("--text"),
    grid: { stroke: () => color("--line"), width: 1 },
    ticks: { stroke: () => color("--line"), width: 1 },
    font: "12px system-ui, sans-serif",
    labelFont: "12px system-ui, sans-serif",
    ...(label ? { label, labelSize: 18, size: 52 } : { size: 34 }),
  };
}

function series(label, name, unit, dash) {
  return {
    label,
    mark: `var(${name})`,
    stroke: () => color(name),
    width: 2,
    dash,
    points: { show: false },
    value: (_plot, value) => (value == null ? "--" : `${value.toFixed(1)} ${unit}`),
  };
}

const FIELDS = ["opening", "command", "force", "set"];

export class Plots {
  /* Draws into `place`. `name` tells a screen reader whose they are. */
  #columns = { time: [], opening: [], command: [], force: [], set: [] };
  #plots;
  #isDue = false;

  constructor(place, name) {
    const sync = { key: name };
    const make = (title, unit, lines) => {
      const figure = document.createElement("figure");
      figure.setAttribute("role", "img");
      figure.setAttribute("aria-label", `${name}: ${title} over time`);
      place.append(figure);
      const plot = new uPlot(
        {
          width: Math.max(figure.clientWidth, 200),
          height: HEIGHT,
          cursor: { sync },
          legend: { markers: { stroke: (_plot, index) => lines[index - 1]?.mark ?? "" } },
          scales: { y: { range: range(unit) } },
          series: [{ label: "time", value: "{HH}:{mm}:{ss}" }, ...lines],
          axes: [
            { ...axis(""), values: [
              [60, "{HH}:{mm}", null, null, null, null, null, null, 1],
              [1, "{HH}:{mm}:{ss}", null, null, null, null, null, null, 1],
              [0.001, "{ss}.{fff}", null, null, null, null, null, null, 1],
            ] },
            axis(`${title} [${unit}]`),
          ],
        },
        [[], ...lines.map(() => [])],
        figure,
      );
      new ResizeObserver(() => {
        plot.setSize({ width: Math.max(figure.clientWidth, 200), height: HEIGHT });
      }).observe(figure);
      /* What stands still, a dump's, is not drawn again by itself. */
      addEventListener("theme", () => plot.redraw());
      return plot;
    };
    this.#plots = [
      make("opening", "mm", [
        series("measured", "--measured", "mm"),
        series("commanded", "--commanded", "mm", [6, 4]),
      ]),
      make("force", "N", [
        series("measured", "--measured", "N"),
        series("set", "--commanded", "N", [6, 4]),
      ]),
    ];
  }

  /* Begin anew with moments of the last minute, the oldest first. What was drawn before them stays: a daemon that has
     begun again knows nothing of what led to that. */
  begin(moments) {
    const { time } = this.#columns;
    const fromS = Math.min(moments[0]?.time ?? Infinity, Date.now() / 1000);
    while (time.at(-1) >= fromS) for (const column of Object.values(this.#columns)) column.pop();
    for (const moment of moments) this.#push(moment);
    this.#drawSoon(this.#columns.time.at(-1));
  }

  /* Add a moment: {time (Unix, s), opening, command, force, set}; what is unknown is null. */
  add(moment) {
    if (moment.time <= this.#columns.time.at(-1)) return; // it was in what this page began with
    this.#push(moment);
    this.#drawSoon(moment.time);
  }

  /* Let the time go on while nothing comes. */
  advance(now) {
    this.#drawSoon(now);
  }

  /* Where nothing was measured, no line is drawn. */
  #push(moment) {
    const columns = this.#columns;
    const last = columns.time.at(-1);
    if (moment.time - last > GAP_S) {
      columns.time.push(last + GAP_S / 2);
      for (const field of FIELDS) columns[field].push(null);
    }
    columns.time.push(moment.time);
    for (const field of FIELDS) columns[field].push(moment[field] ?? null);
    while (columns.time[0] < moment.time - WINDOW_S) {
      for (const column of Object.values(columns)) column.shift();
    }
  }

  #drawSoon(now) {
    if (this.#isDue || now === undefined) return;
    this.#isDue = true;
    requestAnimationFrame(() => {
      this.#isDue = false;
      this.#draw();
      for (const plot of this.#plots) plot.setScale("x", { min: now - WINDOW_S, max: now });
    });
  }

  /* Show these columns, whole. */
  show(columns) {
    this.#columns = columns;
    this.#draw();
  }

  #draw() {
    const { time, opening, command, force, set } = this.#columns;
    this.#plots[0].setData([time, opening, command]);
    this.#plots[1].setData([time, force, set]);
  }
}
