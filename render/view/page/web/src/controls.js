// What a visitor reads and operates: names, numbers, layers, legend, timeline, keys.

import * as colours from "./colours.js";
import { element } from "./element.js";
import { LAYERS } from "./file_scene.js";
import { counted, STEP_WORDS } from "./tooltip.js";

const SPEEDS = [1, 2, 5, 10, 20, 50, 100, 1000]; // times slower than it was
const SLOWEST = 1000;

export const ratioText = (slowness) => `1:${slowness < 10 ? Number(slowness.toFixed(1)) : Math.round(slowness)}`;

export function heading(page, recordings) {
  const files = recordings.map((file, i) =>
    element(
      "li",
      { class: `file${i}` },
      element("b", {}, file.object),
      element("span", {}, `strategy ${file.strategy}`),
      element("span", {}, `hand ${file.hand}`),
      element("span", { class: "quiet" }, element("span", { class: "file-name" }, file.name), posesText(file)),
      ...(page.titles?.[i] ? [element("span", { class: "quiet" }, page.titles[i])] : []),
    ),
  );
  const notes = (page.notes ?? []).map((note) => element("p", { class: "message" }, note));
  const back = page.titles?.length ? [element("a", { href: "#" }, "back to the table")] : [];
  return element("header", {}, ...back, element("h1", {}, page.title), element("ul", { class: "files" }, ...files), ...notes);
}

function posesText(file) {
  if (!file.isStored) return file.pose_count ? `, ${counted(file.pose_count, "pose")}` : "";
  return `, ${storedText(file)}`;
}

function storedText(file) {
  const index = file.poses.index;
  const [first, last] = [index[0], index[index.length - 1]];
  if (index.length === file.pose_count) return counted(file.pose_count, "pose");
  const every = index.length > 1 ? index[1] - index[0] : 1;
  const which = every > 1 ? `every ${every}th of poses ${first} to ${last}` : `poses ${first} to ${last}`;
  return `${which} of ${file.pose_count}`;
}

// Numbers of the shown pose of each file, over its view.
export class Readouts {
  constructor(host, recordings) {
    this.recordings = recordings;
    this.boxes = recordings.map((file, i) => {
      const lines = { label: element("b", {}, file.label), pose: element("output"), numbers: element("output") };
      const names = recordings.length > 1 ? [lines.label] : [];
      host.append(element("div", { class: `readout view${i} file${i}` }, ...names, lines.pose, lines.numbers));
      return lines;
    });
  }

  show() {
    this.recordings.forEach((file, i) => {
      const { row, steps } = file;
      const { index, length, draw_frequency, tilt, time } = file.poses;
      const when = file.has_time ? ` · ${time[row].toFixed(3)} s` : "";
      this.boxes[i].pose.value = file.words ?? `pose ${index[row]}${file.pose_count > 1 ? ` of 0..${file.pose_count - 1}` : ""}${when}`;
      const frequency = draw_frequency[row] > 0 ? ` · ${draw_frequency[row].toFixed(1)} Hz` : ""; // foci may stand still
      const drawn = length[row] > 0 ? `${(1000 * length[row]).toFixed(1)} mm${frequency}` : "no contour";
      const counts = [counted(steps.jump[row], "jump"), counted(steps.hop[row], "hop")].filter(Boolean);
      this.boxes[i].numbers.value = Number.isNaN(length[row])
        ? (file.isLive ? "" : "not rendered yet")
        : [drawn, `tilt ${tilt[row].toFixed(1)}°`, ...counts].join(" · ");
    });
  }
}

// What the colours mean, of all that was shown so far.
export class Legend {
  constructor(host, recordings) {
    this.recordings = recordings;
    this.host = element("ul", { class: "legend" });
    host.append(this.host);
  }

  show() {
    const seen = new Set(this.recordings.flatMap((file) => [...file.seen]));
    const { pressure: print, isStored, row } = this.recordings.find(({ pressure }) => pressure) ?? {};
    const peak = print?.peak[isStored ? row : 0];
    const stamp = [...seen, peak].join();
    if (stamp === this.stamp) return;
    this.stamp = stamp;
    const rows = colours.KINDS.flatMap((colour, kind) => (seen.has(`kind${kind}`) ? [legendRow("line", colour, colours.KIND_NAMES[kind])] : []));
    if (seen.has("fade")) rows.push(legendRow("fade", null, "paler: weaker"));
    if (seen.has("focus")) rows.push(legendRow("dot", colours.FOCUS, "focal point and trail"));
    if (seen.has("jump")) rows.push(legendRow("dash", colours.JUMP, "jump", STEP_WORDS.jump));
    if (seen.has("hop")) rows.push(legendRow("dash", colours.HOP, "hop", STEP_WORDS.hop));
    if (print) rows.push(scaleRow(print.colours, peak));
    this.host.replaceChildren(...rows);
  }
}

function legendRow(kind, colour, text, words = "") {
  const mark = element("i", { class: kind });
  if (colour) mark.style.setProperty("--colour", colour);
  return element("li", { title: words }, mark, text);
}

// The scale of a print of pressure: colours from 0 to its peak.
function scaleRow(table, peak) {
  const mark = element("i", { class: "scale" });
  const stops = Array.from({ length: 9 }, (_, i) => `rgb(${table.slice(3 * Math.round((255 * i) / 8), 3 * Math.round((255 * i) / 8) + 3).join()})`);
  mark.style.background = `linear-gradient(to right, ${stops.join()})`;
  const words = "Mean radiation pressure of one draw cycle, predicted; right to some 50 %";
  return element("li", { title: words, class: "pressure" }, "pressure 0", mark, `${peak.toPrecision(3)} Pa`);
}

export function layerSwitches(recordings, poses, stage) {
  const shown = LAYERS.filter((name) => recordings.some((file) => has(file, name)));
  const boxes = shown.map((name) => {
    const box = element("input", { type: "checkbox", name: `layer-${name.replace(" ", "-")}`, checked: true });
    box.addEventListener("change", () => stage.setVisible(name, box.checked));
    const colour = colours.LAYERS[name];
    const mark = element("i", { class: colour ? "patch" : "none" });
    if (colour) mark.style.setProperty("--colour", colour);
    return element("label", { title: `Key ${shown.indexOf(name) + 1}` }, box, mark, name);
  });
  const more = poses.setPressure ? [pressureChoice(poses)] : [];
  return element("fieldset", { class: "layers" }, element("legend", {}, "Show"), ...boxes, ...more);
}

function pressureChoice(poses) {
  const places = { "": "off", skin: "on the skin", plane: "in a level plane" };
  const choice = element("select", { id: "pressure" }, ...Object.entries(places).map(([value, text]) => element("option", { value }, text)));
  choice.addEventListener("change", () => poses.setPressure(choice.value || null));
  return element("label", { title: "Predicted mean radiation pressure of one draw cycle" }, "pressure", choice);
}

// Layers that something shown now, or later, can be in.
function has(file, layer) {
  const isLater = !file.isStored;
  if (layer === "hand") return file.skin.vertex_count > 0 && !file.skin.is_rendered;
  if (layer === "skin") return isLater || file.seen.has("skin");
  if (layer === "jumps") return isLater || file.seen.has("jump") || file.seen.has("hop");
  if (layer === "focal point") return isLater || file.seen.has("focus");
  if (layer === "pressure") return file.isStored && file.pressure !== null; // a served page has a choice for it
  return true;
}

export function timeline(clock, focus) {
  const play = element("button", { id: "play", type: "button", onclick: () => clock.toggle() });
  const step = (count, text, name) =>
    element("button", { type: "button", title: name, "aria-label": name, onclick: () => clock.step(count) }, text);
  const slider = element("input", { id: "time", type: "range", min: 0, max: clock.last, step: 1, "aria-label": "Time" });
  slider.addEventListener("input", () => {
    clock.isPlaying = false;
    clock.goTo(slider.valueAsNumber);
  });
  const now = element("output", { id: "now" });
  clock.onChange(() => {
    slider.value = clock.at;
    now.value = clock.text;
    slider.setAttribute("aria-valuetext", now.value);
    play.textContent = clock.isPlaying ? "Pause" : "Play";
  });
  const speed = element("select", { id: "speed" }, ...SPEEDS.map((each) => element("option", { value: each }, ratioText(each))));
  speed.addEventListener("change", () => (clock.slowness = Number(speed.value)));
  for (const part of [play, slider]) part.disabled = clock.last === 0;
  return element(
    "div",
    { class: "timeline", hidden: clock.poses.isLive === true },
    play,
    step(-1, "‹", "One pose back (left arrow)"),
    step(1, "›", "One pose on (right arrow)"),
    slider,
    now,
    element("label", { title: "Speed of the hand's motion: 1:1 is as it was" }, "Motion ", speed),
    slownessSlider(focus),
  );
}

function slownessSlider(focus) {
  const shown = element("output", { id: "slowness-shown" }, ratioText(focus.slowness));
  const slider = element("input", { id: "slowness", type: "range", min: 0, max: 3, step: 0.05 });
  slider.value = Math.log10(focus.slowness);
  slider.addEventListener("input", () => {
    focus.slowness = Math.min(10 ** slider.valueAsNumber, SLOWEST);
    shown.value = ratioText(focus.slowness);
  });
  return element("label", { title: "Slow motion of the focal point: 1:1 is as it was" }, "Focal point ", slider, shown);
}

export function listenToKeys(clock, stage) {
  document.addEventListener("click", ({ detail, target }) => {
    if (detail) target.closest("button, input[type=checkbox]")?.blur(); // else the space bar would press it again
  });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || isOfControl(event)) return;
    const actions = {
      " ": () => event.target.closest("button") || clock.toggle(),
      ArrowLeft: () => clock.step(event.shiftKey ? -10 : -1),
      ArrowRight: () => clock.step(event.shiftKey ? 10 : 1),
      Home: () => clock.goTo(0),
      End: () => clock.goTo(clock.last),
      r: () => stage?.look(),
      "?": () => document.getElementById("help").showModal(),
      "<": () => stepOption("speed", 1),
      ">": () => stepOption("speed", -1),
    };
    if (/^[1-9]$/.test(event.key)) document.querySelectorAll(".layers input")[event.key - 1]?.click();
    if (!actions[event.key]) return;
    if (!event.target.closest("button")) event.preventDefault();
    actions[event.key]();
  });
}

function stepOption(id, count) {
  const choice = document.getElementById(id);
  choice.selectedIndex = Math.min(Math.max(choice.selectedIndex + count, 0), choice.options.length - 1);
  choice.dispatchEvent(new Event("change"));
}

// Sliders take arrows, Home and End for themselves; boxes, choices and what unfolds take the space bar, too.
function isOfControl({ target, key }) {
  if (target.closest("input[type=range]")) return key !== " " && key !== "r";
  return target.closest("input, select, summary, dialog") !== null;
}

const KEYS = [
  ["Space", "plays, and stops"],
  ["← →", "one pose back, or on; with Shift ten"],
  ["Home End", "the first pose, the last one"],
  ["< >", "slower, faster"],
  ["1 … 9", "shows a layer, or hides it, in their order"],
  ["R", "turns the view back"],
  ["?", "shows this list"],
];

function help(isLive) {
  const rows = KEYS.slice(isLive ? 4 : 0).map(([keys, words]) => element("tr", {}, element("th", {}, keys), element("td", {}, words)));
  const close = element("button", { type: "button", onclick: () => dialog.close() }, "Close");
  const mouse = "Drag turns the view, the wheel zooms, the right button moves it.";
  const words = [mouse, isLive ? "Keys of the terminal change what is drawn." : "Click or drag in a plot to move the time.", ...Object.values(STEP_WORDS).map((each) => `A ${each.replace(":", " is")}.`)].join(" ");
  const dialog = element("dialog", { id: "help" }, element("table", {}, ...rows), element("p", {}, words), close);
  return dialog;
}

// More poses of unfinished files are done, or a file is whole by now.
export function showNews({ names }) {
  document.querySelectorAll(".file-name").forEach((node, i) => (node.textContent = names[i]));
}

export function footer(page, recordings, licences) {
  const notes = recordings.flatMap((file) => notesOf(file)).filter((note, i, all) => all.indexOf(note) === i);
  const made = page.titles ? `Shown by palpate ${page.version}. ` : `Made with palpate ${page.version} from ${recordings.map(({ name }) => name).join(" and ")}. `;
  const dialog = help(recordings.some(({ isLive }) => isLive));
  return element(
    "footer",
    {},
    element("p", {}, made, ...notes.map((note) => `${note} `)),
    element("button", { type: "button", class: "plain", onclick: () => dialog.showModal() }, "Keys (?)"),
    element("details", {}, element("summary", {}, "Licences"), element("pre", {}, licences)),
    dialog,
  );
}

function notesOf(file) {
  const { solid, focus, contours, sampling } = file;
  const notes = [];
  if (contours) notes.push(`Places are rounded to ${(1000 * Math.max(contours.step, solid.step)).toPrecision(2)} mm.`);
  if (file.isLive) notes.push(`The focal point follows ${sampling}.`);
  else if (!focus) notes.push(`The focal point follows ${sampling}, from two poses before the shown one on.`);
  else if (focus.position.length) notes.push(`The focal point follows ${sampling}${focus.stride > 1 ? `; of poses with many samples, up to every ${focus.stride}th is shown` : ""}.`);
  if (solid.tolerance) notes.push(`The object is shown with ${solid.faces.length / 3} of ${solid.face_count} triangles.`);
  return notes;
}
