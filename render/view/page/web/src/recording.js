// One file's poses: where each begins in the arrays, and which is shown. A page that was exported takes all poses at
// once, one that is served takes each when it is shown.

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
    this.byPose = byPose;
    this.isStored = file.poses !== undefined;
    this.seen = new Set(); // what the legend must explain
    this.stamp = 0; // counts changes of what is shown
    this.row = 0;
    this.pressure = file.pressure ?? null;
    if (this.isStored) this.take(file);
  }

  take({ poses, solid, skin, contours, focus }) {
    Object.assign(this.solid, solid);
    Object.assign(this.skin, skin);
    Object.assign(this, { poses, contours, focus });
    this.count = poses.index.length;
    this.clock = this.byPose ? Float64Array.from(poses.index) : poses.time;
    this.polylineStart = startsOf(contours.polyline_count);
    this.pointStart = startsOf(contours.point_count);
    this.sampleStart = startsOf(focus.sample_count);
    this.patchStart = startsOf(this.skin.patch_count);
    this.steps = this.countSteps();
    if (!this.isStored) this.pressure = null; // it was of another pose
    this.look();
  }

  // The hand of a live run is gone.
  lose(words) {
    this.isLost = true;
    this.words = words;
    this.stamp += 1;
    for (const name of ["length", "draw_frequency", "tilt"]) this.poses[name].fill(NaN);
    this.polylineStart.fill(0);
    this.sampleStart.fill(0);
    this.patchStart.fill(0);
    for (const name of ["jump", "hop"]) this.steps[name].fill(0);
  }

  takePressure(print) {
    this.pressure = print;
    this.stamp += 1;
  }

  show(row) {
    if (row !== this.row || !this.isStored) this.stamp += 1;
    this.row = row;
  }

  // Range of the shown pose's samples of the focal point, and how many there are a second.
  get shownFocus() {
    return { first: this.sampleStart[this.row], stop: this.sampleStart[this.row + 1], rate: this.focus.rate[this.row] };
  }

  // Calls back with both ends of each segment of the shown contours, as numbers of points.
  forSegments(callback) {
    for (let line = this.polylineStart[this.row]; line < this.polylineStart[this.row + 1]; line++) {
      for (let point = this.pointStart[line]; point + 1 < this.pointStart[line + 1]; point++) callback(point, point + 1);
    }
  }

  look() {
    const { kind, intensity } = this.contours;
    for (const each of new Set(kind)) this.seen.add(`kind${each}`);
    if (intensity) this.seen.add("fade");
    if (this.focus.position.length) this.seen.add("focus");
    for (const name of ["jump", "hop"]) if (this.steps[name].some(Boolean)) this.seen.add(name);
    if (this.skin.corners.length || this.skin.is_rendered) this.seen.add("skin");
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
