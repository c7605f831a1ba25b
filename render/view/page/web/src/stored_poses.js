// Poses that the page holds itself: all of them are at hand.

export class StoredPoses {
  constructor(recordings, byPose) {
    this.recordings = recordings;
    this.byPose = byPose;
    this.moments = Float64Array.from(new Set(recordings.flatMap(({ clock }) => [...clock]))).sort();
    [this.count, this.begin, this.end] = [this.moments.length, this.moments[0], this.moments[this.moments.length - 1]];
    this.onFound = () => {};
  }

  // When the longest contours of the first file are shown: a hand that touches nothing shows little.
  get start() {
    const { clock, poses } = this.recordings[0];
    let [longest, most] = [0, 0];
    poses.length.forEach((length, row) => {
      if (length > most) [longest, most] = [row, length]; // a pose that is not rendered has none
    });
    return lastNotAfter(this.moments, clock[longest]);
  }

  find({ at, time = this.moments[at] }) {
    for (const recording of this.recordings) recording.show(lastNotAfter(recording.clock, time));
    const number = at ?? lastNotAfter(this.moments, time);
    this.onFound({ at: number, time });
  }

  // What plots show: all poses.
  begun(plots) {
    plots.fill(this.recordings.map(({ clock, poses, steps }) => ({ clock, ...poses, ...steps })));
  }

  advance() {}

  isAwaited() {
    return false;
  }
}

// Number of the last of increasing values that is not after one, or of the first.
export function lastNotAfter(values, one) {
  let [low, high] = [0, values.length];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (values[middle] <= one) low = middle;
    else high = middle;
  }
  return low;
}
