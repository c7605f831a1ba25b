// Line segments of changing number, in pixels of width; buffers grow and are never made anew for a frame.

import { InstancedInterleavedBuffer, InterleavedBufferAttribute, DynamicDrawUsage } from "three";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";

export class Segments extends LineSegments2 {
  constructor(width, options = {}) {
    super(
      new LineSegmentsGeometry(),
      new LineMaterial({ linewidth: width, vertexColors: true, transparent: true, depthWrite: false, ...options }),
    );
    this.frustumCulled = false; // its box is that of no segments
    this.count = 0;
    this.grow(64);
  }

  grow(capacity) {
    this.capacity = capacity;
    this.place = new InstancedInterleavedBuffer(new Float32Array(6 * capacity), 6, 1).setUsage(DynamicDrawUsage);
    this.colour = new InstancedInterleavedBuffer(new Float32Array(6 * capacity), 6, 1).setUsage(DynamicDrawUsage);
    this.geometry.dispose();
    this.geometry.setAttribute("instanceStart", new InterleavedBufferAttribute(this.place, 3, 0));
    this.geometry.setAttribute("instanceEnd", new InterleavedBufferAttribute(this.place, 3, 3));
    this.geometry.setAttribute("instanceColorStart", new InterleavedBufferAttribute(this.colour, 3, 0));
    this.geometry.setAttribute("instanceColorEnd", new InterleavedBufferAttribute(this.colour, 3, 3));
  }

  // Begins a new set of at most `most` segments.
  begin(most) {
    if (most > this.capacity) this.grow(2 * most);
    this.count = 0;
  }

  // A segment between rows a and b of `points`, in colours [red, green, blue] at both ends.
  add(points, a, b, from, to) {
    const at = 6 * this.count++;
    for (let axis = 0; axis < 3; axis++) {
      this.place.array[at + axis] = points[3 * a + axis];
      this.place.array[at + 3 + axis] = points[3 * b + axis];
      this.colour.array[at + axis] = from[axis];
      this.colour.array[at + 3 + axis] = to[axis];
    }
  }

  end() {
    this.geometry.instanceCount = this.count;
    this.visible = this.count > 0;
    this.place.needsUpdate = this.colour.needsUpdate = true;
    if (this.material.dashed && this.count) this.computeLineDistances();
  }
}
