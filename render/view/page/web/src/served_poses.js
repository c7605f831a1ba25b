// Poses that are asked for when they are shown, from a server that has the files: a file may have millions.

const REST = 0.3; // [s] without another pose, before slower things are asked for
const REFRESH = 1; // [s] between looks at a file that is still being written
const LONGEST_WAIT = 100; // [ms] for a pose, until the one before is drawn again
const OFTEN = 0.4; // [s] between plots while it plays

export class ServedPoses {
  constructor(link, page, recordings, show) {
    this.link = link;
    this.recordings = recordings;
    this.show = show; // shows a failure, a note, or news, which come from the server
    Object.assign(this, page.timeline); // count, begin, end, byPose, start
    this.byPose = page.timeline.by_pose;
    this.leading = page.timeline.file; // on whose poses the slider stands
    this.news = page;
    this.onFound = () => {};
    this.wish = null; // the newest that has not been asked for
    this.busy = 0; // requests that are under way
    this.asked = null; // when the pose that is under way was asked for [ms]
    this.poses = []; // of each file, that are shown
    this.window = null; // of the clock, that plots show
    this.where = null; // of the print of pressure that is wanted
    this.isSettled = true;
    [this.rested, this.looked, this.plotted] = [0, 0, OFTEN];
  }

  find(wish) {
    this.wish = wish;
    this.next();
  }

  next() {
    if (this.busy || !this.wish) return;
    const { at, time } = this.wish;
    this.wish = null;
    this.asked = performance.now();
    this.ask(at === undefined ? { ask: "moment", time } : { ask: "moment", pose: [at] }, (answer) => {
      answer.files.forEach((block, i) => {
        this.recordings[i].take(block);
        this.recordings[i].show(0);
      });
      this.poses = answer.poses;
      this.show.message(answer.notes.join(" "));
      [this.rested, this.isSettled] = [0, false];
      this.onFound({ at: answer.poses[this.leading], time: at === undefined ? undefined : answer.time });
    });
  }

  // One request after the other; then the newest moment that was wished for meanwhile.
  async ask(request, take) {
    this.busy += 1;
    try {
      take(await this.link.ask(request));
    } catch (error) {
      this.show.message(error.message, true);
      if (request.ask === "news") this.news.is_sealed = true; // it is gone: there will be no more news
    }
    this.busy -= 1;
    this.asked = null;
    this.next();
  }

  begun(plots) {
    this.plots = plots;
    plots.fillOverview(this.news.overview);
  }

  // A pose is under way, and soon there: a picture of the one before would only delay it.
  isAwaited() {
    return this.asked !== null && performance.now() - this.asked < LONGEST_WAIT;
  }

  // Called for each frame: asks for what takes longer once the time rests, and for news of unfinished files.
  advance(seconds, clock) {
    this.rested += seconds;
    this.looked += seconds;
    this.plotted += seconds;
    if (this.asked !== null && performance.now() - this.asked > 10 * LONGEST_WAIT) this.show.message("The viewer is busy with another page ...");
    if (this.busy || this.wish || !this.poses.length) return;
    if (!this.news.is_sealed && this.looked > REFRESH) this.look();
    else if (this.isOutside(clock.time) && (clock.isPlaying ? this.plotted > OFTEN : this.rested > REST)) this.fillPlots();
    else if (!this.isSettled && !clock.isPlaying && this.rested > REST) this.settle();
  }

  isOutside(time) {
    if (!this.window) return true;
    const [from, to, isWhole] = this.window;
    const margin = (to - from) / 5;
    return !isWhole && (time < from + margin || time > to - margin) && this.poses[this.leading] !== this.plottedAt;
  }

  fillPlots() {
    this.plotted = 0;
    this.plottedAt = this.poses[this.leading];
    this.ask({ ask: "series", poses: this.poses }, ({ files }) => {
      const cut = files.filter(({ is_whole }) => !is_whole).map(({ clock }) => clock);
      this.window = [Math.max(...cut.map((clock) => clock[0])), Math.min(...cut.map((clock) => clock[clock.length - 1])), !cut.length];
      this.plots.fill(files);
    });
  }

  settle() {
    this.isSettled = true;
    const { poses, where } = this;
    if (!where) return;
    this.ask({ ask: "pressure", poses, where }, ({ files }) => {
      if (where !== this.where) return;
      files.forEach((print, i) => this.recordings[i].takePressure(print));
      this.onFound({ at: poses[this.leading] });
    });
  }

  setPressure(where) {
    this.where = where;
    this.isSettled = false;
    for (const recording of this.recordings) recording.takePressure(null);
    this.onFound({ at: this.poses[this.leading] });
  }

  look() {
    this.looked = 0;
    this.ask({ ask: "news", done: this.news.done }, (answer) => {
      if (answer.kind === "same") return;
      Object.assign(this.news, answer);
      this.show.news(answer);
      this.plots.fillOverview(answer.overview);
      this.window = this.plottedAt = null;
      this.wish ??= { at: this.poses[this.leading] }; // it may be rendered by now
    });
  }
}
