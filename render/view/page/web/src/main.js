// The page: takes its data from itself or from a server, builds what is seen, and lets two times run: the hand's, and
// the focal point's.

import { Clock } from "./clock.js";
import * as controls from "./controls.js";
import { decode, inflate } from "./decode.js";
import { element } from "./element.js";
import { Experimenter } from "./experimenter.js";
import { Link } from "./link.js";
import { LivePoses } from "./live_poses.js";
import { Participant } from "./participant.js";
import { Plots } from "./plots.js";
import { Recording } from "./recording.js";
import { ServedPoses } from "./served_poses.js";
import { Stage } from "./stage.js";
import { StoredPoses } from "./stored_poses.js";
import { openTable } from "./table.js";
import "../node_modules/uplot/dist/uPlot.min.css";
import "./page.css";
import "./study.css";

const text = (id) => document.getElementById(id).textContent;
const LONGEST_FRAME = 0.1; // [s]: after a pause of drawing, time goes on from where it was
const host = document.getElementById("page");
const message = element("p", { class: "message", role: "status", hidden: true });

async function start() {
  if (typeof DecompressionStream === "undefined") {
    host.textContent = "This page needs a browser of 2023 or newer.";
    return;
  }
  const described = JSON.parse(text("described"));
  if (described.page === "participant") return new Participant(host, described.lost).run();
  if (described.page === "experimenter") return new Experimenter(host).run();
  if (described.served) return openServed();
  const page = decode(described, await inflate(text("content")));
  const byPose = !page.files.every((file) => file.has_time);
  const recordings = page.files.map((file) => new Recording(file, byPose));
  build(page, recordings, new StoredPoses(recordings, byPose));
}

async function openServed() {
  const link = new Link(showMessage);
  host.replaceChildren(message);
  await link.opened;
  const page = await openTable(link, host, message, showMessage);
  if (!page) return; // the table is shown
  document.title = page.title;
  const byPose = page.timeline?.by_pose ?? false;
  const recordings = page.files.map((file) => new Recording(file, byPose));
  const show = { message: showMessage, news: controls.showNews };
  build(page, recordings, new (page.kind === "live" ? LivePoses : ServedPoses)(link, page, recordings, show));
}

function showMessage(sentence, isFailure = false) {
  message.textContent = sentence;
  message.hidden = !sentence;
  message.classList.toggle("failure", isFailure);
}

function build(page, recordings, poses) {
  const clock = new Clock(poses);
  const focus = { slowness: 100, seconds: 0 };
  const scene = element("div", { class: "scene" });
  const plots = element("div", { class: "plots" });
  const side = element("aside", {}, plots);
  host.dataset.files = recordings.length;
  host.replaceChildren(
    controls.heading(page, recordings),
    message,
    element("main", {}, scene, side),
    controls.timeline(clock, focus),
    controls.footer(page, recordings, text("licences")),
  );
  const lines = new Plots(plots, recordings, clock);
  let isBuilt = false;
  clock.onChange(() => {
    if (!isBuilt) {
      isBuilt = true; // the first pose is there
      buildScene(page, recordings, poses, clock, focus, scene, side);
    }
    lines.showTime();
    host.dataset.ready = "true";
  });
  poses.begun(lines);
  clock.goTo(poses.start);
}

function buildScene(page, recordings, poses, clock, focus, scene, side) {
  const legend = new controls.Legend(scene, recordings);
  const readouts = new controls.Readouts(scene, recordings);
  const stage = makeStage(scene, recordings, page);
  if (stage) side.prepend(controls.layerSwitches(recordings, poses, stage));
  else legend.host.remove();
  controls.listenToKeys(clock, stage);
  clock.onChange(() => {
    readouts.show();
    legend.show();
  });
  run(clock, focus, recordings, stage);
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
  const showPoses = () => {
    recordings.forEach((recording, i) => {
      if (recording.stamp === shown[i]) return;
      shown[i] = recording.stamp;
      stage.files[i].show();
      stage.isStale = true;
      if (clock.isPlaying && focus.slowness <= clock.slowness) focus.seconds = 0; // the pose's samples begin with it
    });
  };
  const frame = (now) => {
    const seconds = Math.min((now - before) / 1000, LONGEST_FRAME);
    before = now;
    if (clock.isPlaying || !isStill.matches) focus.seconds += seconds / focus.slowness;
    if (stage && !clock.poses.isAwaited()) {
      showPoses();
      recordings.forEach((recording, i) => {
        const { first, stop, rate } = recording.shownFocus;
        if (stop === first && !stage.isStale) return;
        const lasts = (stop - first) / rate || 1;
        stage.files[i].showFocus(focus.seconds % lasts, seconds / focus.slowness);
        stage.isStale ||= stop - first > 1 && (clock.isPlaying || !isStill.matches);
      });
      stage.draw();
    }
    clock.poses.advance(seconds, clock); // before the clock asks for the next pose: plots and news have their turn
    clock.advance(seconds);
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}

start().catch((error) => {
  host.textContent = `This page cannot be shown (${error.message}).`;
  throw error;
});
