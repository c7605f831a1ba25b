// Length, draw frequency and tilt over the clock; a click or a drag moves the time.

import uPlot from "uplot";
import * as colours from "./colours.js";
import { element } from "./element.js";

const FREQUENCY_SHOWN = 1000; // [Hz]; contours of a few millimetres would stretch the axis a hundredfold
const PLOTS = [
  { name: "length", title: "Length of contours", unit: "mm", factor: 1000, digits: 1 },
  { name: "draw_frequency", title: "Draw frequency", unit: "Hz", factor: 1, digits: 1, logarithmic: true },
  { name: "tilt", title: "Tilt of the palm", unit: "°", factor: 1, digits: 1 },
];
const AXIS = { stroke: "#6b7280", font: "11px system-ui, sans-serif", ticks: { show: false }, border: { show: false } };
const GRID = { stroke: "#e8eaed", width: 1 };

export class Plots {
  constructor(host, recordings, clock) {
    this.clock = clock;
    this.recordings = recordings;
    this.lines = PLOTS.map((plot) => this.addPlot(host, plot));
    clock.onChange(() => this.showTime());
    const resize = new ResizeObserver(() => this.resize());
    for (const { area } of this.lines) resize.observe(area);
  }

  addPlot(host, plot) {
    const values = this.recordings.map(() => element("output"));
    const area = element("div", { class: "plot-area" });
    const title = element("figcaption", {}, element("span", {}, plot.title, " ", element("i", {}, plot.unit)));
    values.forEach((value, i) => {
      if (values.length > 1) title.append(element("b", { class: `file${i}` }, value));
      else title.append(element("b", {}, value));
    });
    host.append(element("figure", { class: "plot", id: `plot-${plot.name}` }, title, area));
    const tables = this.recordings.map(({ clock, poses }) => [
      Array.from(clock),
      Array.from(poses[plot.name], (value) => (isShown(plot, value) ? value * plot.factor : null)),
    ]);
    const chart = new uPlot(this.optionsOf(plot, tables), uPlot.join(tables), area);
    const cursor = element("div", { class: "now" });
    chart.over.append(cursor);
    this.listen(chart);
    return { chart, area, cursor, values, plot };
  }

  optionsOf(plot, tables) {
    const isSingle = this.clock.last === 0;
    return {
      width: 320,
      height: 120,
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { show: false }, x: false, y: false },
      padding: [6, 8, 0, 0],
      scales: {
        x: { time: false, range: (_, low, high) => (isSingle ? [low - 1, low + 1] : [low, high]) },
        y: plot.logarithmic ? { distr: 3, range: decades } : { range: fromZero },
      },
      axes: [
        { ...AXIS, grid: GRID, size: 24, gap: 5, space: 60, values: (_, splits) => splits.map(this.clockText()) },
        { ...AXIS, grid: GRID, size: 42, gap: 4, space: 26, values: (_, splits) => splits.map((v) => (v === null ? "" : `${v}`)) },
      ],
      series: [
        {},
        ...tables.map((_, i) => ({
          stroke: colours.FILES[i],
          width: 1.25,
          points: { show: this.clock.last < 40, size: isSingle ? 8 : 4, fill: colours.FILES[i] },
        })),
      ],
      hooks: plot.name === "length" ? { draw: [(chart) => this.markSteps(chart)] } : {},
    };
  }

  clockText() {
    const { byPose, moments, last } = this.clock;
    const isShown = (value) => value !== null && (last > 0 || value === moments[0]) && (!byPose || Number.isInteger(value));
    return (value) => (isShown(value) ? `${value}${byPose ? "" : " s"}` : "");
  }

  // Poses whose focal point jumps or hops, as ticks along the plot's lower edge.
  markSteps(chart) {
    const { ctx, bbox } = chart;
    const tick = 5 * devicePixelRatio;
    ctx.save();
    for (const [name, colour, rise] of [["hop", colours.HOP, 1], ["jump", colours.JUMP, 0]]) {
      ctx.fillStyle = colour;
      for (const { steps, clock } of this.recordings) {
        steps[name].forEach((count, row) => {
          if (!count) return;
          const x = chart.valToPos(clock[row], "x", true);
          ctx.fillRect(x - devicePixelRatio / 2, bbox.top + bbox.height - (rise + 1) * tick, devicePixelRatio, tick);
        });
      }
    }
    ctx.restore();
  }

  listen(chart) {
    const seek = (event) => this.clock.seek(chart.posToVal(event.clientX - chart.over.getBoundingClientRect().left, "x"));
    chart.over.addEventListener("pointerdown", (event) => {
      chart.over.setPointerCapture(event.pointerId);
      this.clock.isPlaying = false;
      seek(event);
    });
    chart.over.addEventListener("pointermove", (event) => event.buttons & 1 && seek(event));
  }

  showTime() {
    for (const { chart, cursor, values, plot } of this.lines) {
      cursor.style.transform = `translateX(${chart.valToPos(this.clock.time, "x")}px)`;
      this.recordings.forEach((recording, i) => {
        const value = recording.poses[plot.name][recording.rowAt(this.clock.time)];
        values[i].value = isShown(plot, value) ? `${(value * plot.factor).toFixed(plot.digits)}${plot.unit === "°" ? "" : " "}${plot.unit}` : "–";
      });
    }
  }

  resize() {
    for (const { chart, area } of this.lines) {
      const { clientWidth: width, clientHeight: height } = area;
      if (width && height && (width !== chart.width || height !== chart.height)) chart.setSize({ width, height });
    }
    this.showTime();
  }
}

// A pose that is not rendered has no length; foci that stand still draw nothing again and again.
function isShown(plot, value) {
  return Number.isFinite(value) && (value > 0 || !plot.logarithmic);
}

function fromZero(_, low, high) {
  return low === null ? [0, 1] : [Math.min(0, low), Math.max(1.05 * high, 1)];
}

function decades(_, low, high) {
  if (low === null) return [10, 100];
  const floor = 10 ** Math.floor(Math.log10(Math.min(low, FREQUENCY_SHOWN / 10)));
  return [floor, Math.min(10 ** Math.ceil(Math.log10(Math.max(high, 10 * floor))), Math.max(FREQUENCY_SHOWN, 10 * floor))];
}
