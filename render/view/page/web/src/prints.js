// Prints of pressure: rectangles of skin, or a plane, or a mesh of skin, coloured cell by cell.

import { BufferAttribute, BufferGeometry, DataTexture, DoubleSide, LinearFilter, Mesh, MeshBasicMaterial, SRGBColorSpace } from "three";

const OPACITY = 0.9;
const WEAKEST = 110; // of 255: where no sound presses, what is behind shows through
const CORNERS = new BufferAttribute(Float32Array.from([0, 0, 1, 0, 1, 1, 0, 1]), 2);

export class Prints {
  constructor(layer) {
    this.layer = layer;
    this.shown = null;
  }

  // Of the recording's pose, if it has a print; hand: the mesh of the hand, which a print may be on.
  show({ pressure, row, isStored, skin }, hand) {
    if (!pressure && !this.shown) return;
    for (const mesh of [...this.layer.children]) {
      mesh.material.map?.dispose();
      mesh.material.dispose();
      mesh.geometry.dispose();
      this.layer.remove(mesh);
    }
    this.shown = pressure;
    if (!pressure) return;
    const number = isStored ? row : 0;
    const before = pressure.plane_count.subarray(0, number).reduce((a, b) => a + b, 0);
    const cells = (plane) => pressure.shape[2 * plane] * pressure.shape[2 * plane + 1];
    let at = 0;
    for (let plane = 0; plane < before; plane++) at += cells(plane);
    for (let plane = before; plane < before + pressure.plane_count[number]; plane++) {
      this.addPlane(pressure, plane, pressure.values.subarray(at, at + cells(plane)));
      at += cells(plane);
    }
    if (!pressure.shape.length && pressure.values.length && hand) {
      this.addSkin(pressure, pressure.values.subarray(number * skin.vertex_count, (number + 1) * skin.vertex_count), hand);
    }
  }

  addPlane({ corners, shape, colours }, plane, values) {
    const texels = new Uint8Array(4 * values.length).fill(255);
    values.forEach((value, i) => texels.set([...colours.subarray(3 * value, 3 * value + 3), WEAKEST + ((255 - WEAKEST) * value) / 255], 4 * i));
    const texture = new DataTexture(texels, shape[2 * plane + 1], shape[2 * plane]);
    texture.colorSpace = SRGBColorSpace;
    texture.magFilter = texture.minFilter = LinearFilter;
    texture.needsUpdate = true;
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(corners.slice(12 * plane, 12 * plane + 12), 3));
    geometry.setAttribute("uv", CORNERS);
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    this.add(geometry, { map: texture });
  }

  addSkin({ colours }, values, hand) {
    const geometry = hand.geometry.clone();
    const colour = new Uint8Array(3 * values.length);
    values.forEach((value, i) => colour.set(colours.subarray(3 * value, 3 * value + 3), 3 * i));
    geometry.setAttribute("color", new BufferAttribute(colour, 3, true));
    const mesh = this.add(geometry, { vertexColors: true });
    mesh.position.copy(hand.position);
    mesh.quaternion.copy(hand.quaternion);
  }

  add(geometry, options) {
    const material = new MeshBasicMaterial({ transparent: true, opacity: OPACITY, side: DoubleSide, depthWrite: false, ...options });
    const mesh = new Mesh(geometry, material);
    mesh.renderOrder = 4;
    mesh.frustumCulled = false;
    this.layer.add(mesh);
    return mesh;
  }
}
