// The drawing: a view for each file, one camera for all, drawn only when something has changed.

import { Box3, PerspectiveCamera, Sphere, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import * as colours from "./colours.js";
import { element } from "./element.js";
import { FileScene } from "./file_scene.js";
import { showTooltip, STEP_WORDS } from "./tooltip.js";

const ELEVATION = (34 * Math.PI) / 180;
const AZIMUTH = (-60 * Math.PI) / 180;

const STACKED = 520; // [pixel] of width: two views stand one above the other
const WIDE = 600; // [pixel]: a view that has room for words
const NEAR = 7; // [pixel] from a jump, where the pointer is on it

export class Stage {
  constructor(host, recordings, arrays, bounds) {
    this.host = host;
    this.renderer = new WebGLRenderer({ antialias: true });
    this.renderer.setClearColor(colours.PAPER);
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.autoClear = false;
    const canvas = this.renderer.domElement;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "Object, hand, array and contours in space");
    host.prepend(canvas);
    this.files = recordings.map((recording) => new FileScene(recording, arrays));
    this.camera = new PerspectiveCamera(32, 1, 0.01, 20);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => (this.isStale = true));
    this.controls.enableZoom = window === window.top; // in a frame, the wheel is the outer page's until the view is clicked
    canvas.addEventListener("webglcontextrestored", () => (this.isStale = true));
    canvas.addEventListener("pointerdown", () => (this.controls.enableZoom = true));
    this.ball = ballOf(bounds, arrays, recordings);
    this.camera.far = Math.max(20, 10 * this.ball.radius);
    this.zones = this.files.flatMap((_, view) =>
      arrays.map(({ zone, zone_text }) => ({ view, corners: zone, words: zone_text, label: element("span", { class: "zone-label" }) })),
    );
    host.append(...this.zones.map(({ label }) => label));
    canvas.addEventListener("pointermove", (event) => showTooltip(event.buttons ? "" : this.wordsAt(event), event));
    canvas.addEventListener("pointerleave", (event) => showTooltip("", event));
    this.isStale = true;
    new ResizeObserver(() => this.resize()).observe(host);
    this.resize();
    this.look();
  }

  // The camera back to where it began: all of the object, the hand's places and the array in sight.
  look() {
    const across = Math.tan((this.camera.fov * Math.PI) / 360) * Math.min(1, this.camera.aspect);
    const away = (this.ball.radius * 0.86) / Math.sin(Math.atan(across));
    const flat = Math.cos(ELEVATION);
    this.controls.target.copy(this.ball.center);
    this.camera.position
      .set(flat * Math.cos(AZIMUTH), flat * Math.sin(AZIMUTH), Math.sin(ELEVATION))
      .multiplyScalar(away)
      .add(this.ball.center);
    this.controls.update();
    this.isStale = true;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    const isStacked = width < STACKED;
    this.host.classList.toggle("stacked", isStacked);
    const columns = isStacked ? 1 : this.files.length;
    const rows = this.files.length / columns;
    this.views = this.files.map((_, i) => ({
      left: columns > 1 ? (i * width) / columns : 0,
      bottom: columns > 1 ? 0 : ((rows - 1 - i) * height) / rows,
      width: width / columns,
      height: height / rows,
    }));
    this.camera.aspect = this.views[0].width / this.views[0].height;
    this.camera.updateProjectionMatrix();
    this.isStale = true;
  }

  setVisible(layer, isVisible) {
    for (const file of this.files) file.setVisible(layer, isVisible);
    if (layer === "zone") for (const { label } of this.zones) label.hidden = !isVisible;
    this.isStale = true;
  }

  draw() {
    if (!this.isStale) return;
    this.isStale = false;
    this.renderer.setScissorTest(false);
    this.renderer.clear();
    this.renderer.setScissorTest(true);
    this.views.forEach(({ left, bottom, width, height }, i) => {
      this.renderer.setViewport(left, bottom, width, height);
      this.renderer.setScissor(left, bottom, width, height);
      this.renderer.render(this.files[i].scene, this.camera);
    });
    for (const { view, corners, label, words } of this.zones) {
      const { left, bottom, width, height } = this.views[view];
      const top = this.host.clientHeight - bottom - height;
      const inside = corners.map((corner) => this.pixelOf(corner, view)).filter(([x, y]) => x > left && x < left + width && y > top + 80 && y < top + height - 40);
      const [x, y] = inside.reduce((last, each) => (each[0] > last[0] ? each : last), [left + 12, top + 80]); // on the right, no array is under it
      label.textContent = width < WIDE ? "focal zone" : words;
      label.style.transform = `translate(${Math.min(x + 6, left + width - label.offsetWidth - 6)}px, ${y}px)`;
    }
  }

  // Where a place [m] is in a view [pixel, from the scene's left upper corner].
  pixelOf(place, view) {
    const { left, bottom, width, height } = this.views[view];
    const { x, y } = new Vector3(...place).project(this.camera);
    return [left + ((x + 1) / 2) * width, this.host.clientHeight - bottom - ((y + 1) / 2) * height];
  }

  // What is under the pointer: a jump or a hop.
  wordsAt({ offsetX, offsetY }) {
    const view = this.views.findIndex(({ left, bottom, width, height }) => {
      const up = this.host.clientHeight - offsetY - bottom;
      return offsetX >= left && offsetX < left + width && up >= 0 && up < height;
    });
    const file = this.files[view];
    if (!file?.jumped || !file.layers.jumps.visible) return "";
    const { position, stride } = file.recording.focus;
    const at = (number) => Array.from(position.subarray(3 * number, 3 * number + 3));
    for (const { from, to, name, sample } of file.jumped) {
      const [a, b] = [at(from), at(to)];
      if (distance([offsetX, offsetY], this.pixelOf(a, view), this.pixelOf(b, view)) > NEAR) continue;
      const far = (1000 * Math.hypot(...a.map((value, axis) => b[axis] - value))).toFixed(1);
      const between = stride > 1 ? `between shown samples ${sample - 1} and ${sample}` : `from sample ${sample - 1} to ${sample}`;
      return `${far} mm ${between} of this pose. A ${STEP_WORDS[name].replace(":", " is")}.`;
    }
    return "";
  }
}

// Of a point from a segment [pixel].
function distance([x, y], [ax, ay], [bx, by]) {
  const [dx, dy] = [bx - ax, by - ay];
  const share = Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1), 0), 1);
  return Math.hypot(x - ax - share * dx, y - ay - share * dy);
}

// Around the object, wherever it moves, the hand's places, and the arrays.
function ballOf([low, high], arrays, recordings) {
  const box = new Box3(new Vector3(...low), new Vector3(...high));
  for (const { plate } of arrays) for (const corner of plate) box.expandByPoint(new Vector3(...corner));
  for (const { solid } of recordings) {
    const size = new Box3().setFromArray(solid.vertices).getSize(new Vector3());
    for (let row = 0; solid.pose && row < solid.pose.length; row += 7) {
      box.union(new Box3().setFromCenterAndSize(new Vector3().fromArray(solid.pose, row), size));
    }
  }
  return box.getBoundingSphere(new Sphere());
}
