// What a visitor reads and operates: names, numbers, layers, legend, timeline, keys.

import * as colours from "./colours.js";
import { element } from "./element.js";
import { LAYERS } from "./file_scene.js";

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
      element("span", { class: "quiet" }, `${file.name}, ${posesText(file)}`),
    ),
  );
  return element("header", {}, element("h1", {}, page.title), element("ul", { class: "files" }, ...files));
}

function posesText(file) {
  const index = file.poses.index;
  const [first, last] = [index[0], index[index.length - 1]];
  if (index.length === file.pose_count) return `${file.pose_count} pose${file.pose_count > 1 ? "s" : ""}`;
  const every = index.length > 1 ? index[1] - index[0] : 1;
  const which = every > 1 ? `every ${every}th of poses ${first} to ${last}` : `poses ${first} to ${last}`;
  return `${which} of ${file.pose_count}`;
}

// Numbers of the shown pose of each file, over its view.
export class Readouts {
  constructor(host, recordings, clock) {
    this.recordings = recordings;
    this.clock = clock;
    this.boxes = recordings.map((file, i) => {
      const lines = { label: element("b", {}, file.label), pose: element("output"), numbers: element("output") };
      const names = recordings.length > 1 ? [lines.label] : [];
      host.append(element("div", { class: `readout view${i} file${i}` }, ...names, lines.pose, lines.numbers));
      return lines;
    });
    clock.onChange(() => this.show());
  }

  show() {
    this.recordings.forEach((file, i) => {
      const row = file.rowAt(this.clock.time);
      const { index, length, draw_frequency, tilt, time } = file.poses;
      const when = file.has_time ? ` · ${time[row].toFixed(3)} s` : "";
      const { jump, hop } = file.steps;
      this.boxes[i].pose.value = `pose ${index[row]}${file.pose_count > 1 ? ` of 0..${file.pose_count - 1}` : ""}${when}`;
      const frequency = draw_frequency[row] > 0 ? ` · ${draw_frequency[row].toFixed(1)} Hz` : ""; // foci may stand still
      const drawn = length[row] > 0 ? `${(1000 * length[row]).toFixed(1)} mm${frequency}` : "no contour";
      const steps = `${counted(jump[row], "jump")}${counted(hop[row], "hop")}`;
      this.boxes[i].numbers.value = Number.isNaN(length[row])
        ? "not rendered yet"
        : `${drawn} · tilt ${tilt[row].toFixed(1)}°${steps}`;
    });
  }
}

const counted = (count, name) => (count ? ` · ${count} ${name}${count > 1 ? "s" : ""}` : "");

export function legend(recordings) {
  const rows = colours.KINDS.flatMap((colour, kind) =>
    recordings.some((file) => file.hasKind(kind)) ? [legendRow("line", colour, colours.KIND_NAMES[kind])] : [],
  );
  if (recordings.some((file) => file.contours.intensity)) rows.push(legendRow("fade", null, "paler: weaker"));
  if (recordings.some((file) => file.focus.position.length)) rows.push(legendRow("dot", colours.FOCUS, "focal point and trail"));
  if (recordings.some((file) => file.steps.jump.some(Boolean))) rows.push(legendRow("dash", colours.JUMP, "jump"));
  if (recordings.some((file) => file.steps.hop.some(Boolean))) rows.push(legendRow("dash", colours.HOP, "hop"));
  return element("ul", { class: "legend" }, ...rows);
}

function legendRow(kind, colour, text) {
  const mark = element("i", { class: kind });
  if (colour) mark.style.setProperty("--colour", colour);
  return element("li", {}, mark, text);
}

export function layerSwitches(recordings, onSwitch) {
  const shown = LAYERS.filter((name) => recordings.some((file) => has(file, name)));
  const boxes = shown.map((name) => {
    const box = element("input", { type: "checkbox", name: `layer-${name.replace(" ", "-")}`, checked: true });
    box.addEventListener("change", () => onSwitch(name, box.checked));
    const colour = colours.LAYERS[name];
    const mark = element("i", { class: colour ? "patch" : "none" });
    if (colour) mark.style.setProperty("--colour", colour);
    return element("label", {}, box, mark, name);
  });
  return element("fieldset", { class: "layers" }, element("legend", {}, "Show"), ...boxes);
}

function has(file, layer) {
  if (layer === "hand") return file.skin.vertex_count > 0 && !file.skin.is_rendered;
  if (layer === "skin") return file.skin.corners.length > 0 || file.skin.is_rendered;
  if (layer === "jumps") return file.focus.step.some(Boolean);
  if (layer === "focal point") return file.focus.position.length > 0;
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
    const time = clock.moments[clock.at];
    now.value = clock.byPose ? `pose ${time}` : `${time.toFixed(3)} s`;
    slider.setAttribute("aria-valuetext", now.value);
    play.textContent = clock.isPlaying ? "Pause" : "Play";
  });
  const speed = element("select", { id: "speed" }, ...SPEEDS.map((each) => element("option", { value: each }, ratioText(each))));
  speed.addEventListener("change", () => (clock.slowness = Number(speed.value)));
  for (const part of [play, slider]) part.disabled = clock.last === 0;
  return element(
    "div",
    { class: "timeline" },
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
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || isOfControl(event)) return;
    const actions = {
      " ": () => event.target.closest("button") || clock.toggle(),
      ArrowLeft: () => clock.step(event.shiftKey ? -10 : -1),
      ArrowRight: () => clock.step(event.shiftKey ? 10 : 1),
      Home: () => clock.goTo(0),
      End: () => clock.goTo(clock.last),
      r: () => stage?.look(),
    };
    if (!actions[event.key]) return;
    if (!event.target.closest("button")) event.preventDefault();
    actions[event.key]();
  });
}

// Sliders take arrows, Home and End for themselves; boxes, choices and what unfolds take the space bar, too.
function isOfControl({ target, key }) {
  if (target.closest("input[type=range]")) return key !== " " && key !== "r";
  return target.closest("input, select, summary") !== null;
}

export function footer(page, recordings, licences) {
  const notes = recordings.flatMap((file) => notesOf(file)).filter((note, i, all) => all.indexOf(note) === i);
  return element(
    "footer",
    {},
    element("p", {}, `Made with palpate ${page.version} from ${recordings.map(({ name }) => name).join(" and ")}. `, ...notes.map((note) => `${note} `)),
    element("p", {}, "Drag turns the view, the wheel zooms, R resets it. Space plays, the arrow keys step, with shift ten poses."),
    element("details", {}, element("summary", {}, "Licences"), element("pre", {}, licences)),
  );
}

function notesOf(file) {
  const { solid, focus, contours, sampling } = file;
  const step = Math.max(contours.step, solid.step);
  const notes = [`Places are rounded to ${(1000 * step).toPrecision(2)} mm.`];
  if (focus.position.length) notes.push(`The focal point follows ${sampling}${focus.stride > 1 ? `; of poses with many samples, up to every ${focus.stride}th is shown` : ""}.`);
  if (solid.tolerance) notes.push(`The object is shown with ${solid.faces.length / 3} of ${solid.face_count} triangles.`);
  return notes;
}
