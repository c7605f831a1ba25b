// The drawing: a view for each file, one camera for all, drawn only when something has changed.

import { Box3, PerspectiveCamera, Sphere, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import * as colours from "./colours.js";
import { FileScene } from "./file_scene.js";

const ELEVATION = (34 * Math.PI) / 180;
const AZIMUTH = (-60 * Math.PI) / 180;

const STACKED = 520; // [pixel] of width: two views stand one above the other

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
    this.ball = ballOf(bounds, arrays, recordings);
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
  }
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
