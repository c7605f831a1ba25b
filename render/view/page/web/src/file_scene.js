// Everything that is drawn of one file: layers by name, moved from pose to pose.

import { BufferAttribute, BufferGeometry, CircleGeometry, Color, DirectionalLight, DoubleSide, Group, HemisphereLight, InstancedMesh } from "three";
import { Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, MultiplyBlending, Quaternion, Scene, SphereGeometry, Vector3 } from "three";
import * as colours from "./colours.js";
import { HOP, JUMP } from "./recording.js";
import { Prints } from "./prints.js";
import { Segments } from "./segments.js";

export const LAYERS = ["object", "hand", "skin", "pressure", "contours", "focal point", "jumps", "array", "zone"];
const TRAIL = 60; // samples behind the focal point
const FOCUS_RADIUS = 0.0028; // [m]

const rgb = (colour) => new Color(colour).toArray();
const mixed = (from, to, share) => from.map((value, axis) => value + (to[axis] - value) * share);
const KINDS = colours.KINDS.map(rgb);
const [PAPER, FOCUS, JUMPED, HOPPED, ZONE] = ["PAPER", "FOCUS", "JUMP", "HOP", "ZONE"].map((name) => rgb(colours[name]));

export function geometryOf(vertices, faces) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(Float32Array.from(vertices), 3));
  geometry.setIndex(new BufferAttribute(Uint32Array.from(faces), 1));
  return geometry;
}

function translucent(geometry, color, opacity) {
  const behind = { transparent: true, depthWrite: false }; // contours behind stay visible
  const material = new MeshLambertMaterial({ color, opacity, side: DoubleSide, flatShading: true, ...behind });
  const mesh = new Mesh(geometry, material);
  mesh.frustumCulled = false; // its vertices change
  return mesh;
}

export function place(node, poses, row) {
  node.position.fromArray(poses, 7 * row);
  node.quaternion.fromArray(poses, 7 * row + 3).normalize();
}

export class FileScene {
  constructor(recording, arrays) {
    this.recording = recording;
    this.scene = new Scene();
    this.layers = Object.fromEntries(LAYERS.map((name) => [name, new Group()]));
    for (const name of LAYERS) this.scene.add(this.layers[name]);
    this.scene.add(new HemisphereLight(0xffffff, 0xb8bcc4, 2.6));
    const sun = new DirectionalLight(0xffffff, 1.4);
    sun.position.set(-0.5, -1, 2);
    this.scene.add(sun);
    this.addSolid();
    this.addHand();
    this.prints = new Prints(this.layers.pressure);
    this.edges = this.addSegments("contours", 7, 5, { opacity: 0.85 }); // of white, so that contours stand out from any skin
    this.contours = this.addSegments("contours", 3.5, 6);
    this.trail = this.addSegments("focal point", 3, 7, { blending: MultiplyBlending, premultipliedAlpha: true }); // white is none
    this.jumps = this.addSegments("jumps", 1.75, 5, { dashed: true, dashSize: 0.003, gapSize: 0.002 });
    this.addFoci();
    for (const array of arrays) this.addArray(array);
  }

  addSegments(layer, width, order, options) {
    const segments = new Segments(width, options);
    segments.renderOrder = order;
    this.layers[layer].add(segments);
    return segments;
  }

  addSolid() {
    const { vertices, faces, middle } = this.recording.solid;
    this.solid = translucent(geometryOf(vertices, faces), colours.SOLID, 0.32);
    this.solid.renderOrder = 1;
    this.solid.position.fromArray(middle);
    this.layers.object.add(this.solid);
  }

  addHand() {
    const { vertices, vertex_count, faces, is_rendered } = this.recording.skin;
    this.hand = null;
    if (vertex_count) {
      const geometry = geometryOf((vertices ?? new Float32Array(3 * vertex_count)).subarray(0, 3 * vertex_count), faces);
      this.hand = translucent(geometry, is_rendered ? colours.PALM : colours.HAND, is_rendered ? 0.4 : 0.34);
      this.hand.renderOrder = 2;
      this.layers[is_rendered ? "skin" : "hand"].add(this.hand);
    }
    this.patches = translucent(new BufferGeometry(), colours.PALM, 0.55);
    this.patches.renderOrder = 3;
    this.layers.skin.add(this.patches);
  }

  addFoci() {
    const material = new MeshBasicMaterial({ color: colours.FOCUS, transparent: true });
    this.foci = [];
    for (let i = 0; i < this.recording.focus.focus_count; i++) {
      const mesh = new Mesh(new SphereGeometry(FOCUS_RADIUS, 20, 12), material);
      mesh.renderOrder = 8;
      this.foci.push(mesh);
      this.layers["focal point"].add(mesh);
    }
  }

  addArray({ transducers, normals, radius, plate, zone }) {
    const count = transducers.length / 3;
    const disc = new CircleGeometry(radius, 24);
    const discs = new InstancedMesh(disc, new MeshLambertMaterial({ color: colours.ARRAY, side: DoubleSide }), count);
    const [up, out, turn, size] = [new Vector3(0, 0, 1), new Vector3(), new Quaternion(), new Vector3(1, 1, 1)];
    for (let i = 0; i < count; i++) {
      turn.setFromUnitVectors(up, out.fromArray(normals, 3 * i));
      discs.setMatrixAt(i, new Matrix4().compose(new Vector3().fromArray(transducers, 3 * i), turn, size));
    }
    discs.frustumCulled = false;
    this.layers.array.add(discs, translucent(geometryOf(plate.flat(), [0, 1, 2, 0, 2, 3]), colours.ARRAY, 0.16));
    const edges = this.addSegments("zone", 1, 0);
    edges.begin(12);
    for (let i = 0; i < 4; i++) {
      const next = (i + 1) % 4;
      for (const [a, b] of [[i, next], [4 + i, 4 + next], [i, 4 + i]]) edges.add(zone.flat(), a, b, ZONE, ZONE);
    }
    edges.end();
  }

  setVisible(layer, isVisible) {
    this.layers[layer].visible = isVisible;
  }

  // Shows the recording's pose.
  show() {
    const { solid, row } = this.recording;
    if (solid.pose) place(this.solid, solid.pose, row);
    this.showHand(row);
    this.showContours();
    this.showJumps();
    this.prints.show(this.recording, this.hand);
  }

  showHand(row) {
    const { skin, poses, patchStart } = this.recording;
    if (this.hand) {
      this.hand.visible = !this.recording.isLost;
      place(this.hand, poses.hand_pose, row);
      if (!skin.is_rigid) {
        const position = this.hand.geometry.getAttribute("position");
        position.array.set(skin.vertices.subarray(3 * skin.vertex_count * row, 3 * skin.vertex_count * (row + 1)));
        position.needsUpdate = true;
      }
    }
    const count = patchStart[row + 1] - patchStart[row];
    this.patches.visible = count > 0;
    if (!count) return;
    const corners = skin.corners.subarray(12 * patchStart[row], 12 * patchStart[row + 1]);
    const faces = Array.from({ length: count }, (_, i) => [0, 1, 2, 0, 2, 3].map((corner) => 4 * i + corner)).flat();
    this.patches.geometry.dispose();
    this.patches.geometry = geometryOf(corners, faces);
  }

  showContours() {
    const { contours, pointStart, polylineStart, row } = this.recording;
    const { points, kind, intensity } = contours;
    const most = pointStart[polylineStart[row + 1]] - pointStart[polylineStart[row]];
    const pale = (point) => (intensity ? 0.85 * (1 - intensity[point] / 255) : 0);
    this.contours.begin(most);
    this.edges.begin(most);
    this.recording.forSegments((a, b) => {
      const colour = KINDS[kind[a]];
      this.contours.add(points, a, b, mixed(colour, PAPER, pale(a)), mixed(colour, PAPER, pale(b)));
      this.edges.add(points, a, b, PAPER, PAPER);
    });
    this.contours.end();
    this.edges.end();
  }

  showJumps() {
    const { position, step, focus_count } = this.recording.focus;
    const { first, stop } = this.recording.shownFocus;
    this.jumped = []; // from and to of each, as numbers of places, and what it is
    this.jumps.begin((stop - first) * focus_count);
    for (let i = first + 1; i < stop; i++) {
      if (!step[i]) continue;
      const colour = step[i] === JUMP ? JUMPED : HOPPED;
      for (let k = 0; k < focus_count; k++) {
        const [from, to] = [(i - 1) * focus_count + k, i * focus_count + k];
        this.jumps.add(position, from, to, colour, colour);
        this.jumped.push({ from, to, name: step[i] === JUMP ? "jump" : "hop", sample: i - first });
      }
    }
    this.jumps.end();
  }

  // seconds: since the pose began; frame: how far the point goes from one picture to the next [s].
  showFocus(seconds, frame) {
    const { position, intensity, step, focus_count } = this.recording.focus;
    const { first, stop, rate } = this.recording.shownFocus;
    const { isLive } = this.recording; // then the newest focal points are there
    const now = isLive ? stop - 1 : Math.min(first + Math.floor(seconds * rate), stop - 1);
    const length = isLive ? TRAIL : Math.max(TRAIL, Math.ceil(2 * frame * rate));
    const from = Math.max(first, now - length);
    this.trail.begin(Math.max(0, now - from) * focus_count);
    this.foci.forEach((mesh, k) => {
      const at = (sample) => sample * focus_count + k;
      mesh.visible = stop > first && intensity[at(now)] > 0;
      if (mesh.visible) mesh.position.fromArray(position, 3 * at(now));
      for (let i = from; i < now; i++) {
        if (step[i + 1] === JUMP || step[i + 1] === HOP || !intensity[at(i)] || !intensity[at(i + 1)]) continue;
        const fade = (sample) => mixed(PAPER, FOCUS, (sample - now + length + 1) / (length + 1));
        this.trail.add(position, at(i), at(i + 1), fade(i), fade(i + 1));
      }
    });
    this.trail.end();
  }
}
