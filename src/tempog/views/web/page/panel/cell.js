/** One cell: its history as a strip, and every interval with its value. */

import { askJson } from "../api.js";
import { byId, el, swatch } from "../dom.js";
import { count, counted, date, duration, offset } from "../format.js";
import { Strip } from "../strip.js";
import { colours, themeName } from "../theme.js";

const MOST_ROWS = 120;

export class CellPanel {
  /** @type {any} */
  #answer = null;
  #strip = null;
  #mark = (_t) => {};
  /** @type {AbortController | null} */
  #asking = null;

  /**
   * @param {import("../state.js").State} state
   * @param {import("../time.js").TimeBar} time
   */
  constructor(state, time) {
    this.state = state;
    this.time = time;
    this.box = byId("panel-cell");
    state.on(["cell"], () => this.load());
    state.on(["t"], () => this.refresh());
    addEventListener("themechange", () => this.#answer && this.#show(state.now.cell));
    time.onGrown(() => this.refresh());
    this.load();
  }

  async load() {
    const { cell } = this.state.now;
    this.#asking?.abort();
    if (!cell) {
      this.#answer = null;
      this.box.replaceChildren(
        el("h2", { text: "A cell's history" }),
        el("p", {
          class: "hint",
          text: "Click a spot of the map, or move to it with the arrow keys and press Enter: every state that it has had is shown here. Where an object is, hold Alt or press for longer.",
        }),
      );
      return;
    }
    const asking = (this.#asking = new AbortController());
    try {
      this.#answer = await askJson("/api/cell", { x: cell[0], y: cell[1] }, asking.signal);
    } catch (error) {
      if (asking.signal.aborted) return;
      this.#answer = null;
      this.box.replaceChildren(
        el("h2", { text: title(cell) }),
        el("p", { class: "hint", role: "alert", text: `No history: ${error.message}` }),
      );
      return;
    }
    this.#show(cell);
  }

  refresh() {
    if (!this.#answer) return;
    this.#strip?.show(this.#bands());
    this.#mark(this.state.now.t ?? 0);
  }

  /** Moments at which the state changed, to step to. */
  get moments() {
    return (this.#answer?.intervals ?? []).map(([start]) => start).slice(1);
  }

  #show(cell) {
    const { intervals, gaps, n_total, truncated, row, col } = this.#answer;
    const now = el("p", { class: "now" });
    const unseen = gaps.reduce((sum, [from, to]) => sum + to - from, 0);
    const canvas = el("canvas", {
      class: "strip",
      role: "img",
      "aria-label": `History: ${counted(n_total ?? intervals.length, "interval")}, not seen for ${duration(unseen)} in between`,
    });
    const body = el("tbody");
    this.box.replaceChildren(
      el(
        "div",
        { class: "heading" },
        el("h2", { text: title(cell) }),
        el("span", { class: "quiet", text: `row ${row}, col ${col}` }),
      ),
      now,
      canvas,
      el(
        "p",
        { class: "key" },
        el("span", {}, swatch(shade(1)), "occupied"),
        el("span", {}, swatch(shade(0)), "free"),
        el("span", {}, swatch(colours().gap, "hatched"), "not seen"),
      ),
      el(
        "p",
        { class: "quiet", hidden: !intervals.length },
        countText(n_total ?? intervals.length, intervals.length),
      ),
      el(
        "table",
        { class: "intervals", hidden: !intervals.length },
        el(
          "thead",
          {},
          el("tr", {}, ...["From", "For", "State", "P(occupied)"].map((text) => el("th", { scope: "col", text }))),
        ),
        body,
      ),
    );
    this.#strip = new Strip(canvas, {
      axis: () => this.time.axis,
      moment: () => this.state.now.t ?? 0,
      go: (t) => this.time.go(t),
    });
    let listed = -2; // the interval that is marked
    this.#mark = (t) => {
      const k = intervals.findLastIndex(([start]) => start <= t);
      now.replaceChildren(
        ...(intervals.length ? nowText(intervals[k], t, truncated) : ["Nothing was ever seen here."]),
      );
      if (k === listed) return;
      listed = k;
      const hasFocus = body.contains(document.activeElement);
      const first = Math.max(0, Math.min(k - MOST_ROWS / 2, intervals.length - MOST_ROWS));
      const rows = intervals.slice(first, first + MOST_ROWS);
      body.replaceChildren(...rows.map((interval, n) => this.#row(interval, first + n === k)));
      const current = body.querySelector("[aria-current]");
      current?.scrollIntoView({ block: "nearest" });
      if (hasFocus) current?.querySelector("button").focus();
    };
    this.refresh();
  }

  #row([start, stop, prob], current) {
    const go = el("button", {
      type: "button",
      class: "when",
      text: offset(start),
      title: date(this.time.clock, start),
      click: () => this.time.go(start),
    });
    return el(
      "tr",
      { "aria-current": current ? "true" : null },
      el("td", {}, go),
      el("td", { class: "number", text: duration(stop - start) }),
      el("td", {}, swatch(shade(prob)), stateName(prob)),
      el("td", { class: "number", text: prob.toFixed(2) }),
    );
  }

  #bands() {
    return this.#answer.intervals.map(([from, to, prob]) => ({ from, to, fill: shade(prob) }));
  }
}

function countText(n, n_sent) {
  return counted(n, "interval") + (n_sent < n ? `, ${count(n_sent)} of them listed` : "");
}

function nowText(interval, t, truncated) {
  if (!interval) return [truncated ? "Only later intervals are listed." : "Not seen yet at this moment."];
  const [, stop, prob] = interval;
  const state = el("strong", { text: stateName(prob) });
  const probable = ` (P = ${prob.toFixed(2)})`;
  return t <= stop
    ? [state, `${probable} at this moment.`]
    : ["Last known: ", state, `${probable}, ${duration(t - stop)} before.`];
}

function stateName(prob) {
  return prob > 0.5 ? "occupied" : "free";
}

/** The shade of a state in the colours of the map. @param {number} prob */
function shade(prob) {
  const [free, occupied] =
    themeName() === "dark"
      ? [
          [29, 32, 38],
          [242, 243, 245],
        ]
      : [
          [255, 255, 255],
          [18, 18, 23],
        ];
  return `rgb(${free.map((value, k) => Math.round(value + (occupied[k] - value) * prob)).join(" ")})`;
}

function title([x, y]) {
  return `Cell at (${x.toFixed(2)}, ${y.toFixed(2)}) m`;
}
