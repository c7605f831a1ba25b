// One clock for all files: which moment is shown, and how it goes on while it plays. The poses come from `poses`
// (stored_poses.js or served_poses.js), which has count, begin, end and byPose, and finds what is shown at a moment.

const STILL = 0.05; // [s] that a pose lasts whose file has no times

export class Clock {
  constructor(poses) {
    this.poses = poses;
    this.unit = poses.byPose ? 1 / STILL : 1; // of the clock in a second
    this.time = poses.begin;
    this.at = 0; // number of the moment, where the slider stands
    this.slowness = 1; // seconds that the viewer waits for one of the recording
    this.isPlaying = false;
    this.listeners = [];
    poses.onFound = (found) => this.found(found);
  }

  get last() {
    return this.poses.count - 1;
  }

  get text() {
    return this.poses.byPose ? `pose ${Math.floor(this.time)}` : `${this.time.toFixed(3)} s`;
  }

  onChange(listener) {
    this.listeners.push(listener);
  }

  // What `poses` has found; time: where the clock goes, if it was asked for the number of a moment.
  found({ at, time = this.time }) {
    this.at = at;
    this.time = time;
    for (const listener of this.listeners) listener();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, this.poses.begin), this.poses.end);
    this.poses.find({ time: this.time });
  }

  goTo(at) {
    this.poses.find({ at: Math.min(Math.max(at, 0), this.last) });
  }

  step(count) {
    this.isPlaying = false;
    this.goTo(this.at + count);
  }

  toggle() {
    this.isPlaying = !this.isPlaying && this.last > 0;
    this.seek(this.isPlaying && this.time >= this.poses.end ? this.poses.begin : this.time);
  }

  advance(seconds) {
    if (!this.isPlaying) return;
    const next = this.time + (seconds * this.unit) / this.slowness;
    this.isPlaying = next < this.poses.end;
    this.seek(next);
  }
}
