// Poses that are asked for when they are shown, from a server that has the files: a file may have millions.

const REST = 0.2; // [s] without another pose, before slower things are asked for
const REFRESH = 1; // [s] between looks at a file that is still being written
const OFTEN = 0.4; // [s] between plots while it plays

export class ServedPoses {
  constructor(link, page, recordings, show) {
    this.link = link;
    this.recordings = recordings;
    this.show = show; // shows a failure, a note, or news, which come from the server
    Object.assign(this, page.timeline); // count, begin, end, byPose, start
    this.byPose = page.timeline.by_pose;
    this.news = page;
    this.onFound = () => {};
    this.wish = null; // the newest that has not been asked for
    this.isBusy = false;
    this.isAwaited = false; // a pose is under way: a picture of the one before would only delay it
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

  async next() {
    if (this.isBusy || !this.wish) return;
    const { at, time } = this.wish;
    this.wish = null;
    this.isAwaited = true;
    await this.asking(async () => {
      const answer = await this.link.ask(at === undefined ? { ask: "moment", time } : { ask: "moment", pose: [at] });
      answer.files.forEach((block, i) => {
        this.recordings[i].take(block);
        this.recordings[i].show(0);
      });
      this.poses = answer.poses;
      this.show.message(answer.notes.join(" "));
      [this.rested, this.isSettled] = [0, false];
      this.onFound({ at: answer.poses[0], time: at === undefined ? undefined : answer.time });
    });
    this.isAwaited = false;
    this.next();
  }

  // One request is under way at a time, so that a slider that is dragged waits for no answer but the last.
  async asking(work) {
    if (this.isBusy) return;
    this.isBusy = true;
    try {
      await work();
    } catch (error) {
      this.show.message(error.message, true);
    } finally {
      this.isBusy = false;
    }
  }

  begun(plots) {
    this.plots = plots;
    plots.fillOverview(this.news.overview);
  }

  // Called for each frame: asks for what takes longer once the time rests, and for news of unfinished files.
  advance(seconds, clock) {
    this.rested += seconds;
    this.looked += seconds;
    this.plotted += seconds;
    if (this.isBusy || this.wish || !this.poses.length) return;
    if (!this.news.is_sealed && this.looked > REFRESH) this.look();
    else if (this.isOutside(clock.time) && (clock.isPlaying ? this.plotted > OFTEN : this.rested > REST)) this.fillPlots();
    else if (!this.isSettled && !clock.isPlaying && this.rested > REST) this.settle();
  }

  isOutside(time) {
    if (!this.window) return true;
    const [from, to, isWhole] = this.window;
    const margin = (to - from) / 5;
    return !isWhole && (time < from + margin || time > to - margin) && this.poses[0] !== this.plottedAt;
  }

  async fillPlots() {
    this.plotted = 0;
    this.plottedAt = this.poses[0];
    await this.asking(async () => {
      const { files } = await this.link.ask({ ask: "series", pose: [this.poses[0]] });
      const { clock, is_whole } = files[0];
      this.window = [clock[0], clock[clock.length - 1], is_whole];
      this.plots.fill(files);
    });
    this.next();
  }

  async settle() {
    this.isSettled = true;
    if (!this.where) return;
    await this.asking(async () => {
      const { poses } = this;
      const answer = await this.link.ask({ ask: "pressure", poses, where: this.where });
      if (poses !== this.poses || !this.where) return; // the hand has gone on, or pressure is switched off
      answer.files.forEach((print, i) => this.recordings[i].takePressure(print));
      this.onFound({ at: this.poses[0] });
    });
    this.next();
  }

  setPressure(where) {
    this.where = where;
    this.isSettled = false;
    for (const recording of this.recordings) recording.takePressure(null);
  }

  noise() {
    return this.asking(async () => {
      this.show.message("Predicting noise ...");
      const answer = await this.link.ask({ ask: "noise", poses: this.poses });
      this.show.message("");
      this.plots.fillNoise(answer);
    });
  }

  async look() {
    this.looked = 0;
    await this.asking(async () => {
      const answer = await this.link.ask({ ask: "news", done: this.news.done });
      if (answer.kind === "same") return;
      Object.assign(this.news, answer);
      this.show.news(answer);
      this.plots.fillOverview(answer.overview);
      this.window = this.plottedAt = null;
      this.wish ??= { at: this.poses[0] }; // it may be rendered by now
    });
    this.next();
  }
}
