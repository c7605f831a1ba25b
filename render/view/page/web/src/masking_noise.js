// Pink noise in a loop, faded in and out, that masks the array's own sound.

const RAMP = 0.05; // [s]

export class MaskingNoise {
  constructor(link) {
    this.link = link;
    this.isWanted = false;
    this.hasOutput = true;
  }

  // Browsers allow sound only after a key was pressed.
  async start() {
    if (this.context) return void (this.context.state === "suspended" && this.context.resume());
    if (!(navigator.userActivation?.hasBeenActive ?? true)) return; // Escape, for one, allows nothing
    if (typeof AudioContext === "undefined") return void (this.hasOutput = false);
    this.context = new AudioContext();
    this.context.onerror = () => (this.hasOutput = false);
    this.gain = new GainNode(this.context, { gain: 0 });
    this.gain.connect(this.context.destination);
    this.findOutput();
    const { samples } = await this.link.ask({ ask: "noise", rate: this.context.sampleRate }).catch((error) => {
      this.context.close();
      this.context = null; // the page was refused, for one: the next key tries again
      throw error;
    });
    const buffer = new AudioBuffer({ length: samples.length, sampleRate: this.context.sampleRate });
    buffer.copyToChannel(samples, 0);
    const source = new AudioBufferSourceNode(this.context, { buffer, loop: true });
    source.connect(this.gain);
    source.start();
    this.isThere = true;
    this.play(this.isWanted);
  }

  // Without a sound card, Chromium plays to nowhere; as it lists outputs, it lists none then.
  async findOutput() {
    if (!("setSinkId" in AudioContext.prototype) || !navigator.mediaDevices) return;
    const devices = await navigator.mediaDevices.enumerateDevices();
    this.hasOutput &&= devices.some(({ kind }) => kind === "audiooutput");
  }

  play(isWanted) {
    this.isWanted = isWanted;
    if (!this.isThere) return;
    const { gain } = this.gain;
    gain.cancelScheduledValues(this.context.currentTime);
    gain.setValueAtTime(gain.value, this.context.currentTime);
    gain.linearRampToValueAtTime(isWanted ? 1 : 0, this.context.currentTime + RAMP);
  }

  state() {
    if (!this.hasOutput) return "missing";
    if (!this.context) return "off";
    if (this.context.state !== "running") return "blocked";
    return this.isWanted && this.isThere ? "playing" : "ready";
  }
}
