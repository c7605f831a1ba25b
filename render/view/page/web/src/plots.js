// Length, draw frequency and tilt over the clock; a click or a drag moves the time. Where a file has more poses than the
// plots show, one more has the longest contours of the whole recording.

import uPlot from "uplot";
import * as colours from "./colours.js";
import { element } from "./element.js";
import { lastNotAfter } from "./stored_poses.js";
import { counted, showTooltip } from "./tooltip.js";

const FREQUENCY_SHOWN = 1000; // [Hz]; contours of a few millimetres would stretch the axis a hundredfold
const FEW = 40; // poses, which are dots on their line
const PLOTS = [
  { name: "length", title: "Length of contours", unit: "mm", factor: 1000, digits: 1 },
  { name: "draw_frequency", title: "Draw frequency", unit: "Hz", factor: 1, digits: 1, logarithmic: true },
  { name: "tilt", title: "Tilt of the palm", unit: "°", factor: 1, digits: 1 },
];
const OVERVIEW = { name: "overview", title: "Whole recording: longest contours", unit: "mm", factor: 1000 };
const AXIS = { stroke: "#6b7280", font: "11px system-ui, sans-serif", ticks: { show: false }, border: { show: false } };
const GRID = { stroke: "#e8eaed", width: 1 };

export class Plots {
  constructor(host, recordings, clock) {
    this.host = host;
    this.clock = clock;
    this.recordings = recordings;
    this.series = recordings.map(() => ({ clock: [], jump: [], hop: [] }));
    this.watcher = new ResizeObserver(() => this.resize());
    this.lines = [];
    for (const plot of PLOTS) this.addPlot(plot);
  }

  addPlot(plot) {
    const values = this.recordings.map((_, i) => element("b", { class: this.recordings.length > 1 ? `file${i}` : "" }));
    const area = element("div", { class: "plot-area" });
    const title = element("figcaption", {}, element("span", {}, plot.title, " ", element("i", {}, plot.unit)), ...values);
    const figure = element("figure", { class: "plot", id: `plot-${plot.name}` }, title, area);
    this.host[plot === OVERVIEW ? "prepend" : "append"](figure);
    const chart = new uPlot(this.optionsOf(plot), [[], ...this.recordings.map(() => [])], area);
    const cursor = element("div", { class: "now" });
    chart.over.append(cursor);
    this.listen(chart, plot);
    this.watcher.observe(area);
    const line = { chart, area, cursor, values, plot };
    this.lines.push(line);
    return line;
  }

  optionsOf(plot) {
    return {
      width: 320,
      height: 120,
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { show: false }, x: false, y: false },
      padding: [6, 8, 0, 0],
      scales: {
        x: { time: false, range: (_, low, high) => (low === high ? [low - 1, low + 1] : [low, high]) },
        y: plot.logarithmic ? { distr: 3, range: decades } : { range: fromZero },
      },
      axes: [
        { ...AXIS, grid: GRID, size: 24, gap: 5, space: 60, values: (_, splits) => splits.map((value) => this.clockText(value)) },
        { ...AXIS, grid: GRID, size: 42, gap: 4, space: 26, values: (_, splits) => splits.map((v) => (v === null ? "" : `${v}`)) },
      ],
      series: [
        {},
        ...this.recordings.map((_, i) => ({
          stroke: colours.FILES[i],
          width: i ? 2 : 1.25,
          dash: i ? [5, 4] : undefined, // the first file's line shows between the dashes of one that lies on it
          points: { show: (chart) => chart.data[0].length < FEW, size: 5, fill: colours.FILES[i] },
        })),
      ],
      hooks: { draw: [(chart) => plot.name === "length" && this.markSteps(chart), () => this.showTime()] },
    };
  }

  clockText(value) {
    const { poses } = this.clock;
    if (value === null || (poses.byPose && !Number.isInteger(value))) return "";
    return poses.count === 1 && !poses.isLive && value !== poses.begin ? "" : `${value}${poses.byPose ? "" : " s"}`;
  }

  // Shows these poses of each file: clock, length, draw_frequency, tilt, and how often the focal point jumps and hops.
  fill(series) {
    this.series = series;
    for (const line of this.lines) if (PLOTS.includes(line.plot)) this.draw(line, series);
  }

  draw({ chart, plot }, series) {
    const tables = series.map((each) => [
      Array.from(each.clock),
      Array.from(each[plot.name], (value) => (isShown(plot, value) ? value * plot.factor : null)),
    ]);
    chart.setData(tables.every(([clock]) => clock.length) ? uPlot.join(tables) : [[], ...tables.map(() => [])]);
  }

  fillOverview(files) {
    if (!files) return; // the other plots show all poses
    const line = this.lines.find(({ plot }) => plot === OVERVIEW) ?? this.addPlot(OVERVIEW);
    this.draw(line, files.map(({ time, length }) => ({ clock: time, overview: length })));
  }

  // Poses whose focal point jumps or hops, as ticks along the plot's lower edge.
  markSteps(chart) {
    const { ctx, bbox } = chart;
    const tick = 5 * devicePixelRatio;
    ctx.save();
    for (const [name, colour, rise] of [["hop", colours.HOP, 1], ["jump", colours.JUMP, 0]]) {
      ctx.fillStyle = colour;
      for (const { clock, ...each } of this.series) {
        each[name].forEach((count, row) => {
          if (!count) return;
          const x = chart.valToPos(clock[row], "x", true);
          ctx.fillRect(x - devicePixelRatio / 2, bbox.top + bbox.height - (rise + 1) * tick, devicePixelRatio, tick);
        });
      }
    }
    ctx.restore();
  }

  listen(chart, plot) {
    const timeAt = (event) => chart.posToVal(event.clientX - chart.over.getBoundingClientRect().left, "x");
    chart.over.addEventListener("pointerdown", (event) => {
      chart.over.setPointerCapture(event.pointerId);
      this.clock.isPlaying = false;
      this.clock.seek(timeAt(event));
    });
    chart.over.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) this.clock.seek(timeAt(event));
      showTooltip(event.buttons ? "" : this.wordsAt(timeAt(event), plot, chart), event);
    });
    chart.over.addEventListener("pointerleave", (event) => showTooltip("", event));
  }

  // What is at a time: the value of each file, and jumps and hops of its poses.
  wordsAt(time, plot, chart) {
    const [clock, ...values] = chart.data;
    if (!clock.length) return "";
    const at = lastNotAfter(clock, time);
    const words = values.flatMap((value) => (Number.isFinite(value[at]) ? [`${value[at].toFixed(1)} ${plot.unit}`] : []));
    if (plot.name === "length") {
      for (const each of this.series) {
        const row = lastNotAfter(each.clock, time);
        words.push(counted(each.jump[row], "jump"), counted(each.hop[row], "hop"));
      }
    }
    return [this.clockText(Number(clock[at].toFixed(3))), ...words].filter(Boolean).join(" · ");
  }

  showTime() {
    for (const { chart, cursor, values, plot } of this.lines) {
      cursor.style.transform = `translateX(${chart.valToPos(this.clock.time, "x")}px)`;
      cursor.hidden = !chart.data[0].length;
      if (!PLOTS.includes(plot)) continue;
      this.recordings.forEach(({ poses, row }, i) => {
        const value = poses?.[plot.name][row];
        const unit = plot.unit === "°" ? "°" : ` ${plot.unit}`;
        values[i].textContent = isShown(plot, value) ? `${(value * plot.factor).toFixed(plot.digits)}${unit}` : "–";
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
