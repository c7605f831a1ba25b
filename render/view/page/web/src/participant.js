// The participant's page of a study: what the desk shows, in large letters, and the keys that it hands back. All words
// come from the server.

import { element } from "./element.js";
import { Link } from "./link.js";
import { MaskingNoise } from "./masking_noise.js";
import { ObjectView } from "./object_view.js";

const PERIOD = 33; // [ms] between requests
const HIDDEN_WAIT = 0.25; // [s] that the server waits instead, as browsers slow down the timers of a page that is hidden
const REFUSED = 1000; // [ms] until a page that may not open asks again
const CAPS = { ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", Enter: "↵", " ": "␣" };
const ROWS = ["1234567890", "qwertyuiop", "asdfghjkl", "zxcvbnm"];
const PLACES = { " ": 4, Enter: 12, ArrowLeft: 13, ArrowUp: 14, ArrowDown: 14, ArrowRight: 15 };
const DECIMAL = /^[+-]?(\d+([.,]\d*)?|[.,]\d+)$/;
const THOUSANDS = /,\d{3}$/; // 1,000 is 1 to some and 1000 to others: it is refused
const SCROLLS = { ArrowDown: 0.3, ArrowUp: -0.3, PageDown: 0.9, PageUp: -0.9 }; // of a text that is higher than the page

// Where a key is, from left to right [key].
function placeOf(key) {
  const row = ROWS.findIndex((keys) => keys.includes(key.toLowerCase()));
  return PLACES[key] ?? (row < 0 ? 16 : ROWS[row].indexOf(key.toLowerCase()) + [0, 0.5, 0.75, 1.25][row]);
}

const pause = (time) => new Promise((done) => setTimeout(done, time));

export class Participant {
  constructor(host, lost) {
    this.host = host;
    this.lost = lost;
    this.number = -1;
    this.link = new Link((sentence) => this.fail(sentence), lost);
    this.noise = new MaskingNoise(this.link);
    this.view = new ObjectView();
    this.words = element("main", {});
    this.more = element("p", { class: "more", "aria-hidden": "true" }, element("kbd", {}, "↑"), element("kbd", {}, "↓"));
    this.title = element("p", { class: "title" });
    this.done = element("progress", { max: 1, value: 0 });
    this.alert = element("p", { class: "alert", role: "alert", hidden: true });
    document.body.classList.add("participant");
    document.addEventListener("keydown", (event) => this.press(event));
    addEventListener("resize", () => this.showMore());
    document.addEventListener("visibilitychange", () => this.wake?.()); // before a timer that is slowed down
  }

  async run() {
    await this.link.opened;
    this.host.replaceChildren(element("header", {}, this.title, this.done), this.view.host, this.words, this.alert);
    while (!this.hasFailed) {
      try {
        const wait = document.hidden ? HIDDEN_WAIT : 0;
        this.take(await this.link.ask({ ask: "screen", after: this.number, wait, sound: this.noise.state() }));
        if (!document.hidden) await Promise.race([pause(PERIOD), new Promise((done) => (this.wake = done))]);
      } catch (error) {
        this.say(error.message);
        this.number = -1;
        await pause(REFUSED);
      }
    }
  }

  // The connection is lost.
  fail(sentence) {
    this.hasFailed = true;
    this.noise.play(false);
    if (this.screen?.kind === "ended") return; // the last words stay
    this.host.replaceChildren(element("main", { class: "lost" }, element("p", { class: "text", role: "alert" }, sentence)));
  }

  say(sentence) {
    this.alert.textContent = sentence;
    this.alert.hidden = !sentence;
  }

  take({ number, screen, left, hand }) {
    if (screen) this.show(number, screen);
    if (left !== undefined) this.rest.textContent = Math.ceil(left);
    this.showObject(hand);
  }

  show(number, screen) {
    Object.assign(this, { number, screen, isAnswered: false, shown: performance.now() });
    requestAnimationFrame((now) => this.number === number && (this.shown = Math.max(this.shown, now, performance.now())));
    this.say("");
    this.rest = element("p", { class: "rest", role: "timer" });
    this.title.textContent = screen.title;
    this.done.value = screen.progress;
    this.host.dataset.kind = screen.kind;
    this.words.classList.toggle("beside", screen.kind === "stimulus"); // the object keeps its place when words go
    this.host.dataset.number = number;
    this.view.host.hidden = !screen.shown;
    const text = screen.text || (screen.question?.text ?? "");
    const isShort = text.length < 140 && !text.includes("\n");
    this.text = element("p", { class: isShort ? "text short" : "text", "aria-live": "polite", onscroll: () => this.showMore() }, text);
    this.words.replaceChildren(
      this.text,
      this.more,
      ...(screen.kind === "rest" ? [this.rest] : []),
      ...this.answers(screen),
      element("p", { class: "hint", hidden: !screen.hint }, screen.hint),
    );
    this.showMore();
    this.words.querySelector("input, textarea")?.focus();
    this.noise.play(screen.has_noise);
  }

  // Of a text that is higher than its place: which arrow keys show more of it.
  showMore() {
    const { scrollTop, scrollHeight, clientHeight } = this.text ?? {};
    this.more.hidden = !this.text || scrollHeight <= clientHeight + 1;
    const [up, down] = this.more.children;
    up.classList.toggle("off", scrollTop < 2);
    down.classList.toggle("off", scrollTop + clientHeight > scrollHeight - 2);
  }

  // The keys that answer, or where to type.
  answers({ question, keys }) {
    if (question && !keys.length && ["number", "text"].includes(question.kind)) {
      const isText = question.kind === "text";
      const attributes = { "aria-label": question.text, autocomplete: "off", spellcheck: "false" };
      if (!isText) return [element("input", { ...attributes, inputmode: "decimal", maxlength: 30 })];
      return [element("textarea", { ...attributes, rows: 3, maxlength: 10000 })];
    }
    const isScale = question?.kind === "scale";
    const caps = [...keys].sort((a, b) => placeOf(a.key) - placeOf(b.key)).map(({ key, label }) => {
      const cap = element("kbd", { class: key === " " ? "space" : "" }, CAPS[key] ?? (key.length === 1 ? key.toUpperCase() : key));
      return element("li", { "data-key": key }, cap, ...(label && label !== key ? [element("span", {}, label)] : []));
    });
    const list = element("ul", { class: isScale ? "keys scale" : "keys", hidden: !caps.length }, ...caps);
    if (!isScale) return [list];
    return [element("div", { class: "points" }, list, element("p", { class: "ends" }, ...[question.low_text, question.high_text].map((end) => element("span", {}, end))))];
  }

  async showObject(hand) {
    const { shown } = this.screen ?? {};
    if (!shown) return this.view.draw(null, 1);
    if (!this.isLoading && (this.view.number !== shown.number || (hand && this.view.hand_number !== hand.number))) {
      this.isLoading = true;
      try {
        this.view.take(await this.link.ask({ ask: "object" }));
      } catch (error) {
        this.say(error.message);
      } finally {
        this.isLoading = false;
      }
    }
    if (this.view.number === shown.number) this.view.draw(hand, shown.opacity);
  }

  press(event) {
    this.noise.start().catch(() => {}); // of a connection that is lost, the page says so itself
    const { key } = event;
    if (event.repeat || event.isComposing || event.ctrlKey || event.altKey || event.metaKey || !this.screen || this.hasFailed) return;
    const field = this.words.querySelector("input, textarea");
    if (field) return this.type(event, field);
    if (key === " " || key === "Tab" || key === "'" || key === "/" || key.startsWith("Arrow") || key.startsWith("Page")) event.preventDefault();
    const choice = this.screen.keys.find((own) => own.key.toLowerCase() === key.toLowerCase());
    if (!choice && key in SCROLLS) return this.text.scrollBy({ top: SCROLLS[key] * this.text.clientHeight });
    if (["Shift", "CapsLock", "NumLock", "Tab", "Control", "Alt", "AltGraph", "Meta", "Dead"].includes(key)) return;
    if (event.timeStamp < this.shown) return; // it was meant for the screen before
    this.send({ ask: "press", key: choice?.key ?? key.slice(0, 40) }, event, choice && (() => this.mark(choice.key)));
  }

  // Enter gives what was typed; everything else goes to the field.
  type(event, field) {
    if (document.activeElement !== field) field.focus();
    if (event.key === "Tab") event.preventDefault();
    if (event.key !== "Enter" || event.shiftKey) return;
    event.preventDefault();
    if (this.isAnswered) return;
    const typed = field.value.trim();
    const isNumber = this.screen.question.kind === "number" && DECIMAL.test(typed) && !THOUSANDS.test(typed);
    const value = isNumber ? Number(typed.replace(",", ".")) : typed || null; // what is no number is refused with a sentence
    this.send({ ask: "give", value }, event, () => (field.readOnly = true));
  }

  async send(request, event, counted) {
    const { number } = this;
    try {
      const { counts } = await this.link.ask({ ...request, screen: number, seconds: Math.max(0, event.timeStamp - this.shown) / 1000 });
      if (!counts || number !== this.number) return;
      this.isAnswered = true;
      this.say("");
      counted?.();
    } catch (error) {
      if (!this.hasFailed) this.say(error.message);
    }
  }

  mark(key) {
    for (const cap of this.words.querySelectorAll("li")) cap.classList.toggle("pressed", cap.dataset.key === key);
  }
}
