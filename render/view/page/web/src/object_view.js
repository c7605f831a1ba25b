// What a participant sees of object and hand: solid, or at an opacity; from their own side, with a camera that rests.

import { BufferGeometry, DirectionalLight, Group, HemisphereLight, Mesh, MeshBasicMaterial, MeshLambertMaterial } from "three";
import { DoubleSide, PerspectiveCamera, Scene, WebGLRenderer } from "three";
import * as colours from "./colours.js";
import { element } from "./element.js";
import { geometryOf, place } from "./file_scene.js";

const ELEVATION = (22 * Math.PI) / 180;
const REACH = 0.05; // [m] around the object, where the hand is seen
const SQUARE = [0, 1, 2, 0, 2, 3];

const solid = (color, options) => new MeshLambertMaterial({ color, flatShading: true, side: DoubleSide, ...options });

export class ObjectView {
  constructor() {
    this.host = element("div", { class: "view", hidden: true });
    this.number = this.hand_number = 0;
    this.scene = new Scene();
    this.scene.add(new HemisphereLight(0xffffff, 0xb8bcc4, 2.6));
    const sun = new DirectionalLight(0xffffff, 1.4);
    sun.position.set(-0.5, -1, 2);
    this.camera = new PerspectiveCamera(28, 1, 0.01, 20);
    this.camera.up.set(0, 0, 1);
    this.object = new Group();
    this.hand = new Group();
    this.skin = new Mesh(new BufferGeometry(), solid(colours.HAND, { flatShading: false }));
    this.patches = new Mesh(new BufferGeometry(), solid(colours.PALM));
    // Behind a translucent surface the hand is seen, but of the object itself only the nearest surface: it is found
    // first, without a colour.
    this.nearest = new Mesh(new BufferGeometry(), new MeshBasicMaterial({ colorWrite: false, side: DoubleSide }));
    this.surface = new Mesh(new BufferGeometry(), solid(colours.SOLID));
    this.nearest.renderOrder = 1;
    this.surface.renderOrder = 2;
    this.hand.add(this.skin);
    this.object.add(this.nearest, this.surface);
    this.scene.add(sun, this.hand, this.patches, this.object);
    for (const mesh of [this.skin, this.patches, this.nearest, this.surface]) mesh.frustumCulled = false;
    try {
      this.renderer = new WebGLRenderer({ antialias: true });
    } catch {
      return; // a browser without WebGL: words and keys work
    }
    this.renderer.setClearColor(colours.PAPER);
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.host.append(this.renderer.domElement);
    new ResizeObserver(() => this.look()).observe(this.host);
  }

  take({ object, hand }) {
    this.hand_number = hand.number;
    this.skin.geometry.dispose();
    this.skin.geometry = geometryOf(hand.vertices, hand.faces);
    this.skin.geometry.computeVertexNormals();
    if (!object) return;
    this.number = object.number;
    this.nearest.geometry.dispose();
    this.nearest.geometry = this.surface.geometry = geometryOf(object.vertices, object.faces);
    this.surface.geometry.computeBoundingSphere();
    this.look();
  }

  // All of the object in sight, from behind -y and a bit above.
  look() {
    const { clientWidth: width, clientHeight: height } = this.host;
    const ball = this.surface.geometry.boundingSphere;
    if (!this.renderer || !width || !height || !ball) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    const half = Math.tan((this.camera.fov * Math.PI) / 360) * Math.min(1, this.camera.aspect);
    const away = (ball.radius + REACH) / Math.sin(Math.atan(half));
    this.camera.position.set(0, -Math.cos(ELEVATION) * away, Math.sin(ELEVATION) * away).add(ball.center);
    this.camera.lookAt(ball.center);
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.scene, this.camera);
  }

  // hand: null where none is seen.
  draw(hand, opacity) {
    if (!this.renderer || this.host.hidden) return;
    const isGlass = opacity < 1;
    if (this.surface.material.transparent !== isGlass) {
      Object.assign(this.surface.material, { transparent: isGlass, needsUpdate: true });
    }
    this.surface.material.opacity = opacity;
    this.nearest.visible = isGlass;
    this.hand.visible = this.patches.visible = Boolean(hand);
    if (hand) {
      place(this.hand, hand.pose, 0);
      const count = hand.patches.length / 12;
      this.patches.geometry.dispose();
      this.patches.geometry = geometryOf(hand.patches, Array.from({ length: count }, (_, i) => SQUARE.map((corner) => 4 * i + corner)).flat());
      this.patches.visible = count > 0;
    }
    this.renderer.render(this.scene, this.camera);
  }
}
