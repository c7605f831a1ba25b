// The table of a sweep: sorted, searched, leafed through; one row, or two, open as renderings. What is open stands in
// the address behind #, so that the browser's own back and reload work.

import { element } from "./element.js";

// What the server shows: files; null: it has a table, which is shown.
export async function openTable(link, host, message, showMessage) {
  addEventListener("hashchange", () => location.reload());
  const numbers = /^#rows=(\d+)(?:,(\d+))?$/.exec(location.hash)?.slice(1).filter(Boolean).map(Number);
  if (!numbers) {
    const page = await link.ask({ ask: "open" });
    if (page.kind === "table") new Table(link, host, message, showMessage, page);
    return page.kind === "table" ? null : page;
  }
  try {
    return await link.ask({ ask: "rows", numbers }, ({ done, count }) => showMessage(`Rendering: ${done} of ${count} poses`));
  } catch (error) {
    host.append(element("p", {}, element("a", { href: "#" }, "back to the table")));
    showMessage(error.message, true);
    return null;
  } finally {
    if (!message.classList.contains("failure")) showMessage("");
  }
}

function keptOf(key) {
  try {
    return JSON.parse(sessionStorage.getItem(key) ?? "{}");
  } catch {
    return {};
  }
}

class Table {
  constructor(link, host, message, showMessage, page) {
    Object.assign(this, { link, showMessage });
    this.key = `palpate table of ${page.title}: ${page.columns.map(({ name }) => name)}`; // of what was sorted and searched
    this.asked = { by: "", falling: false, containing: "", columns: [], page: 0, ...keptOf(this.key) };
    this.chosen = [];
    this.body = element("div", { class: "table" });
    this.count = element("output");
    const search = element("input", { type: "search", placeholder: "words of the axes", "aria-label": "Rows whose axes contain" });
    search.value = this.asked.containing;
    search.addEventListener("input", () => this.ask({ containing: search.value, page: 0 }));
    this.more = element("select", { "aria-label": "Also show a column" });
    this.more.addEventListener("change", () => this.ask({ columns: [...this.asked.columns, this.more.value] }));
    this.open = element("button", { type: "button", onclick: () => (location.hash = `rows=${this.chosen.join()}`) }, "Open");
    const leaf = (text, to) => element("button", { type: "button", onclick: () => this.ask({ page: Math.max(0, to()) }) }, text);
    const [back, next] = [leaf("‹ back", () => this.asked.page - 1), leaf("next ›", () => this.asked.page + 1)];
    host.replaceChildren(
      element("header", {}, element("h1", {}, page.title)),
      message,
      element("div", { class: "timeline" }, search, this.more, back, next, this.count, this.open),
      this.body,
    );
    document.title = page.title;
    this.ask({});
    host.dataset.ready = "true";
  }

  async ask(change) {
    Object.assign(this.asked, change);
    try {
      const answer = await this.link.ask({ ask: "table", ...this.asked });
      this.asked.page = answer.page;
      sessionStorage.setItem(this.key, JSON.stringify(this.asked));
      this.show(answer);
      this.showMessage("");
    } catch (error) {
      this.showMessage(error.message, true);
    }
  }

  show({ columns, rows, more, count, found, page, page_count }) {
    this.count.value = `${found === count ? count : `${found} of ${count}`} rows, page ${page + 1} of ${page_count}`;
    this.more.replaceChildren(...["also show …", ...more].map((name, i) => element("option", { value: i ? name : "", disabled: !i, selected: !i }, name)));
    this.more.hidden = !more.length;
    const heads = columns.map(({ name, text, unit }) => {
      const isSorted = this.asked.by === name;
      const falling = isSorted && !this.asked.falling;
      const mark = isSorted ? (this.asked.falling ? " ▾" : " ▴") : "";
      const press = () => this.ask({ by: name, falling, page: 0 });
      return element("th", { scope: "col" }, element("button", { type: "button", class: "plain", onclick: press }, `${text}${unit ? ` [${unit}]` : ""}${mark}`));
    });
    const lines = rows.map(({ number, cells }) => {
      const box = element("input", { type: "checkbox", "aria-label": `row ${number}`, checked: this.chosen.includes(number) });
      box.addEventListener("change", () => this.choose(number, box.checked));
      const link = element("a", { href: `#rows=${number}` }, `${number}`);
      return element("tr", {}, element("td", {}, box), element("td", {}, link), ...cells.map((text) => element("td", {}, text)));
    });
    const nothing = element("tr", {}, element("td", { colspan: columns.length + 2 }, "no row contains that"));
    const head = element("tr", {}, element("th", {}), element("th", { scope: "col" }, "row"), ...heads);
    this.body.replaceChildren(element("table", {}, element("thead", {}, head), element("tbody", {}, ...(lines.length ? lines : [nothing]))));
    this.choose();
  }

  // Two rows at most are open: a third one chosen takes the place of the first.
  choose(number, isChosen) {
    if (number !== undefined) this.chosen = this.chosen.filter((each) => each !== number).concat(isChosen ? [number] : []).slice(-2);
    this.body.querySelectorAll("input").forEach((box) => (box.checked = this.chosen.includes(Number(box.ariaLabel.slice(4)))));
    this.open.disabled = !this.chosen.length;
    this.open.textContent = this.chosen.length > 1 ? "Open both" : "Open";
  }
}
