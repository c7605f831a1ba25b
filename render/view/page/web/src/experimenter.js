// The experimenter's page of a study: how the run goes, what the participant sees, and stop.

import { element } from "./element.js";
import { Link } from "./link.js";

const PERIOD = 250; // [ms] between requests
const CARDS = {
  Run: ["participant", "block", "trial", "trials", "stimulus", "minutes_left"],
  Array: ["array", "live", "latency", "frames", "dropped", "duty"],
};
const HANDLED = ["has_page", "is_stopped", "stop_reason", "is_ended", "screen", "extra_presses", "sound", "faults", "events"];
const LOST = "The connection to palpate is lost: the run has ended, or its program has. An array is off when its program ends.";

const named = (name) => (name[0].toUpperCase() + name.slice(1)).replaceAll("_", " ");
const rows = (pairs) => element("dl", {}, ...pairs.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]));
const listed = (lines) => element("ul", {}, ...lines.map((line) => element("li", {}, shown(line))));

function shown(value) {
  if (value === null || value === undefined || value === "") return "–";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value === "number") return Number.isInteger(value) ? value.toLocaleString("en") : String(Number(value.toPrecision(3)));
  if (Array.isArray(value)) return value.map(shown).join(", ");
  return typeof value === "object" ? Object.entries(value).map(([name, own]) => `${named(name)}: ${shown(own)}`).join(", ") : value;
}

function shownAs(name, value) {
  if (name !== "latency" || !Array.isArray(value)) return shown(value);
  const [middle, late] = value.map((seconds) => (seconds === null ? "–" : (1000 * seconds).toFixed(1)));
  return `${middle} ms (99 %: ${late} ms)`;
}

export class Experimenter {
  constructor(host) {
    this.link = new Link((sentence) => this.fail(sentence), LOST);
    this.host = host;
    this.state = element("strong", { class: "state", role: "status" });
    this.reason = element("span", { class: "reason" });
    this.done = element("progress", { max: 1, value: 0, "aria-label": "Done of the whole study" });
    this.cards = element("main", {});
    this.alert = element("p", { class: "alert", role: "alert", hidden: true });
    this.buttons = {
      stop: element("button", { class: "stop", onclick: () => this.order("stop") }, "STOP", element("kbd", {}, "S")),
      go_on: element("button", { class: "go", onclick: () => this.order("go_on") }, "Go on", element("kbd", {}, "G")),
      end: element("button", { onclick: () => this.sure.showModal() }, "End the run…"),
    };
    this.sure = element(
      "dialog",
      {},
      element("p", {}, "End the run now? What plays stops. All answers are kept, and the participant can go on another time."),
      element("button", { class: "sure", onclick: () => this.order("end", this.sure.close()) }, "End the run"),
      element("button", { autofocus: true, onclick: () => this.sure.close() }, "No, go on"),
    );
    document.body.classList.add("experimenter");
    document.addEventListener("keydown", ({ key, repeat, ctrlKey, altKey, metaKey }) => {
      if (repeat || ctrlKey || altKey || metaKey) return;
      if (key.toLowerCase() === "s") this.order("stop");
      if (key.toLowerCase() === "g" && !this.sure.open) this.order("go_on");
    });
  }

  async run() {
    await this.link.opened;
    const states = element("div", { class: "states" }, this.state, this.reason);
    this.host.replaceChildren(element("header", {}, states, ...Object.values(this.buttons)), this.alert, this.done, this.cards, this.sure);
    while (!this.hasFailed) {
      await this.order("progress");
      await new Promise((done) => setTimeout(done, PERIOD));
    }
  }

  async order(ask) {
    try {
      this.show(await this.link.ask({ ask }));
      this.alert.hidden = true;
    } catch (error) {
      this.alert.textContent = error.message;
      this.alert.hidden = false;
    }
  }

  fail(sentence) {
    this.hasFailed = true;
    this.sure.close();
    for (const button of Object.values(this.buttons)) button.disabled = true;
    if (this.outcome) return; // the run is over, and so is its program
    this.alert.textContent = sentence;
    this.alert.hidden = false;
    this.host.dataset.state = "lost";
    this.state.textContent = "CONNECTION LOST";
  }

  show({ status, screen }) {
    this.outcome = status.outcome || status.is_ended;
    const [state, words] = status.outcome
      ? ["ended", status.outcome.toUpperCase()]
      : status.is_ended
      ? ["ended", "ENDED"]
      : status.is_stopped
        ? ["stopped", "STOPPED"]
        : status.has_page
          ? ["running", "RUNNING"]
          : ["closed", "WAITING: the participant's page is not open"];
    this.host.dataset.state = state;
    if (this.state.textContent !== words) this.state.textContent = words;
    this.reason.textContent = status.stop_reason;
    this.done.value = screen.progress;
    this.buttons.stop.disabled = status.is_ended;
    this.buttons.go_on.disabled = status.is_ended || !status.is_stopped;
    this.buttons.end.disabled = status.is_ended;
    const known = [...HANDLED, ...Object.values(CARDS).flat()];
    const groups = { ...CARDS, More: Object.keys(status).filter((name) => !known.includes(name)) };
    const card = (title, ...content) => element("section", { "data-card": title }, element("h2", {}, title), ...content);
    const group = ([title, names]) => {
      const there = names.filter((name) => name in status);
      return there.length ? [card(title, rows(there.map((name) => [named(name), shownAs(name, status[name])])))] : [];
    };
    const cards = [
      ...Object.entries(groups).flatMap(group),
      card(
        "Participant's page",
        rows([
          ["Page", status.has_page ? "open" : "not open"],
          ["Shows", screen.kind],
          ["Title", shown(screen.title)],
          ["Text", shown(screen.text || screen.question)],
          ["Hint", shown(screen.hint)],
          ["Keys", element("span", {}, screen.keys.join("\n") || "–")],
          ["Keys too late or twice", shown(status.extra_presses)],
          ["Masking noise", shown(status.sound)],
        ]),
      ),
      card("Faults", status.faults?.length ? listed(status.faults) : element("p", {}, "none")),
      card("Last events", status.events?.length ? listed(status.events.slice(-12).reverse()) : element("p", {}, "none yet")),
    ];
    this.cards.replaceChildren(...cards);
  }
}
