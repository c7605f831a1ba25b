// The page: reads its data, builds what is seen, and lets two times run: the hand's, and the focal point's.

import { Clock } from "./clock.js";
import * as controls from "./controls.js";
import { decode, inflate } from "./decode.js";
import { element } from "./element.js";
import { Plots } from "./plots.js";
import { Recording } from "./recording.js";
import { Stage } from "./stage.js";
import "../node_modules/uplot/dist/uPlot.min.css";
import "./page.css";

const text = (id) => document.getElementById(id).textContent;
const LONGEST_FRAME = 0.1; // [s]: after a pause of drawing, time goes on from where it was

async function start() {
  const host = document.getElementById("page");
  if (typeof DecompressionStream === "undefined") {
    host.textContent = "This page needs a browser of 2023 or newer.";
    return;
  }
  const page = decode(JSON.parse(text("described")), await inflate(text("content")));
  const byPose = !page.files.every((file) => file.has_time);
  const recordings = page.files.map((file) => new Recording(file, byPose));
  const clock = new Clock(recordings, byPose);
  const focus = { slowness: 100, seconds: 0 };
  const scene = element("div", { class: "scene" });
  const plots = element("div", { class: "plots" });
  const side = element("aside", {}, plots);
  host.replaceChildren(
    controls.heading(page, recordings),
    element("main", {}, scene, side),
    controls.timeline(clock, focus),
    controls.footer(page, recordings, text("licences")),
  );
  host.dataset.files = recordings.length;
  scene.append(controls.legend(recordings));
  const readouts = new controls.Readouts(scene, recordings, clock);
  const stage = makeStage(scene, recordings, page);
  if (stage) side.prepend(controls.layerSwitches(recordings, (layer, isShown) => stage.setVisible(layer, isShown)));
  const lines = new Plots(plots, recordings, clock);
  controls.listenToKeys(clock, stage);
  if (!stage) scene.querySelector(".legend").remove();
  if (stage) run(clock, focus, recordings, stage);
  else run(clock, focus, [], { draw: () => {} });
  readouts.show();
  lines.showTime();
  clock.seek(longestMoment(recordings[0]));
  host.dataset.ready = "true";
}

// When the longest contours of a file are shown: a hand that touches nothing shows little.
function longestMoment({ clock, poses }) {
  let [longest, most] = [0, 0];
  poses.length.forEach((length, pose) => {
    if (length > most) [longest, most] = [pose, length]; // a pose that is not rendered has none
  });
  return clock[longest];
}

function makeStage(scene, recordings, page) {
  try {
    return new Stage(scene, recordings, page.arrays, page.bounds);
  } catch {
    const why = "This browser cannot draw in three dimensions (WebGL is turned off or missing). Plots and numbers work.";
    scene.prepend(element("p", { class: "notice" }, why));
    return null;
  }
}

// Draws frame after frame; between changes, nothing is drawn.
function run(clock, focus, recordings, stage) {
  const isStill = matchMedia("(prefers-reduced-motion: reduce)");
  const shown = recordings.map(() => -1);
  let before = performance.now();
  const showRows = () => {
    recordings.forEach((recording, i) => {
      const row = recording.rowAt(clock.time);
      if (row === shown[i]) return;
      shown[i] = row;
      stage.files[i].show(row);
      stage.isStale = true;
      if (clock.isPlaying && focus.slowness <= clock.slowness) focus.seconds = 0; // the pose's samples begin with it
    });
  };
  const frame = (now) => {
    const seconds = Math.min((now - before) / 1000, LONGEST_FRAME);
    before = now;
    clock.advance(seconds);
    showRows();
    if (clock.isPlaying || !isStill.matches) focus.seconds += seconds / focus.slowness;
    recordings.forEach((recording, i) => {
      const { first, stop, rate } = recording.focusOf(shown[i]);
      if (stop === first && !stage.isStale) return;
      const lasts = (stop - first) / rate || 1;
      stage.files[i].showFocus(shown[i], focus.seconds % lasts, seconds / focus.slowness);
      stage.isStale ||= stop - first > 1 && (clock.isPlaying || !isStill.matches);
    });
    stage.draw();
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}

start().catch((error) => {
  document.getElementById("page").textContent = `This page cannot be shown (${error.message}).`;
  throw error;
});
