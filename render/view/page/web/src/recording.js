// One file's poses: where each begins in the arrays, and what is shown of it.

export const JUMP = 1;
export const HOP = 2;

const startsOf = (counts) => {
  const starts = new Uint32Array(counts.length + 1);
  for (let i = 0; i < counts.length; i++) starts[i + 1] = starts[i] + counts[i];
  return starts;
};

export class Recording {
  constructor(file, byPose) {
    Object.assign(this, file);
    this.count = file.poses.index.length;
    this.clock = byPose ? Float64Array.from(file.poses.index) : file.poses.time;
    this.polylineStart = startsOf(file.contours.polyline_count);
    this.pointStart = startsOf(file.contours.point_count);
    this.sampleStart = startsOf(file.focus.sample_count);
    this.patchStart = startsOf(file.skin.patch_count);
    this.steps = this.countSteps();
  }

  // Row of the pose that is shown at a time: the last one that has begun, or the first.
  rowAt(time) {
    let [low, high] = [0, this.count];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.clock[middle] <= time) low = middle;
      else high = middle;
    }
    return low;
  }

  // Range of the pose's samples of the focal point, and how many there are a second.
  focusOf(row) {
    return { first: this.sampleStart[row], stop: this.sampleStart[row + 1], rate: this.focus.rate[row] };
  }

  // Calls back with both ends of each segment of a pose's contours, as numbers of points.
  forSegments(row, callback) {
    for (let line = this.polylineStart[row]; line < this.polylineStart[row + 1]; line++) {
      for (let point = this.pointStart[line]; point + 1 < this.pointStart[line + 1]; point++) callback(point, point + 1);
    }
  }

  // Whether a contour of a kind (0 object, 1 hand, 2 made) is in any pose.
  hasKind(kind) {
    return this.contours.kind.includes(kind);
  }

  countSteps() {
    const found = { jump: new Uint16Array(this.count), hop: new Uint16Array(this.count) };
    for (let row = 0; row < this.count; row++) {
      for (let i = this.sampleStart[row]; i < this.sampleStart[row + 1]; i++) {
        if (this.focus.step[i] === JUMP) found.jump[row]++;
        if (this.focus.step[i] === HOP) found.hop[row]++;
      }
    }
    return found;
  }
}
