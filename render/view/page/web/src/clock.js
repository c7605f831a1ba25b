// One clock for all files: the moments at which any of them shows another pose.

const STILL = 0.05; // [s] that a pose lasts whose file has no times

export class Clock {
  constructor(recordings, byPose) {
    this.moments = Float64Array.from(new Set(recordings.flatMap(({ clock }) => [...clock]))).sort();
    this.unit = byPose ? 1 / STILL : 1; // of the clock in a second
    this.byPose = byPose;
    this.time = this.moments[0];
    this.slowness = 1; // seconds that the viewer waits for one of the recording
    this.isPlaying = false;
    this.listeners = [];
  }

  get at() {
    let [low, high] = [0, this.moments.length];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.moments[middle] <= this.time) low = middle;
      else high = middle;
    }
    return low;
  }

  get last() {
    return this.moments.length - 1;
  }

  onChange(listener) {
    this.listeners.push(listener);
  }

  seek(time) {
    this.time = Math.min(Math.max(time, this.moments[0]), this.moments[this.last]);
    for (const listener of this.listeners) listener();
  }

  goTo(at) {
    this.seek(this.moments[Math.min(Math.max(at, 0), this.last)]);
  }

  step(count) {
    this.isPlaying = false;
    this.goTo(this.at + count);
  }

  toggle() {
    this.isPlaying = !this.isPlaying && this.last > 0;
    if (this.isPlaying && this.at === this.last) this.time = this.moments[0];
    this.seek(this.time);
  }

  advance(seconds) {
    if (!this.isPlaying) return;
    const next = this.time + (seconds * this.unit) / this.slowness;
    this.isPlaying = next < this.moments[this.last];
    this.seek(next);
  }
}
