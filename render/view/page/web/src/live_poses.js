// The pose of a live run that is drawn now, asked for 30 times a second.

const PERIOD = 1 / 30; // [s]
const PLOTTED = 0.25; // [s] between plots
const SHOWN = 10; // [s] of plots
const NAMES = ["clock", "length", "draw_frequency", "tilt", "jump", "hop"];
const STATES = {
  resting: "Nothing is drawn now.",
  "no hand": "No hand is seen.",
  faded: "The tracker is silent: the array is silent, too.",
};

export class LivePoses {
  constructor(link, page, recordings, show) {
    Object.assign(this, { link, recordings, show, scene: page.scene });
    Object.assign(this, { count: 1, begin: 0, end: Infinity, byPose: false, isLive: true, start: 0 });
    recordings[0].isLive = true;
    link.ended = "The run has ended: palpate live starts another, whose page has a new address.";
    this.number = -1;
    this.waited = 0;
    this.plotted = PLOTTED;
    this.series = Object.fromEntries(NAMES.map((name) => [name, []]));
    this.onFound = () => {};
  }

  begun(plots) {
    this.plots = plots;
  }

  find() {
    this.look();
  }

  advance(seconds) {
    this.waited += seconds;
    this.plotted += seconds;
    if (this.waited >= PERIOD) this.look();
  }

  async look() {
    if (this.isBusy) return;
    this.isBusy = true;
    this.waited = Math.min(this.waited - PERIOD, PERIOD);
    try {
      const answer = await this.link.ask({ ask: "now", after: this.number });
      if (answer.scene && answer.scene !== this.scene) return location.reload(); // another object, hand or strategy
      if (answer.files) this.take(answer);
      else if (answer.state in STATES) this.lose(answer.state);
      this.show.message([STATES[answer.state], answer.points_left_out ? "Not all contours are shown." : ""].filter(Boolean).join(" "));
      if (this.number < 0) setTimeout(() => this.look(), 1000 * PERIOD); // no picture asks yet
    } catch (error) {
      this.show.message(error.message, true);
      return;
    } finally {
      this.isBusy = false;
    }
  }

  // No hand, or nothing is drawn: neither stands there any longer.
  lose(state) {
    const [recording] = this.recordings;
    if (this.number < 0 || recording.isLost) return;
    recording.lose(state);
    this.onFound({ at: 0 });
  }

  isAwaited() {
    return false;
  }

  take({ number, time, state, files, latency, dropped, frames }) {
    const [recording] = this.recordings;
    const late = latency[0] === null ? "" : ` · ${(1000 * latency[0]).toFixed(1)} ms from hand to array (99 %: ${(1000 * latency[1]).toFixed(1)})`;
    recording.words = `${time.toFixed(2)} s · ${state}${late} · ${dropped} of ${frames.toLocaleString("en")} frames dropped`;
    recording.isLost = false;
    recording.take(files[0]);
    recording.show(0);
    this.number = number;
    const { poses, steps } = recording;
    const row = [time, poses.length[0], poses.draw_frequency[0], poses.tilt[0], steps.jump[0], steps.hop[0]];
    const gone = this.series.clock.findIndex((each) => each > time - SHOWN);
    NAMES.forEach((name, i) => {
      this.series[name].splice(0, Math.max(gone, 0));
      this.series[name].push(row[i]);
    });
    this.onFound({ at: 0, time });
    if (this.plotted < PLOTTED) return;
    this.plotted = 0;
    this.plots.fill([this.series]);
  }
}
