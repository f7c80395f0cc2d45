/** Two moments side by side in time: what appeared, what vanished, what moved. */

import { askUntilReady } from "../api.js";
import { boundsOf, shapeOf } from "../cells.js";
import { byId, el } from "../dom.js";
import { counted, date, offset, percent, place } from "../format.js";

const MOST_ROWS = 200;
const SIGNS = { moved: "⇄", appeared: "+", vanished: "−" };

export class ComparePanel {
  /** What changed: {moved, appeared, vanished}, each with shapes and bounds; null if nothing is compared. @type {any} */
  changed = null;
  /** @type {any} */
  chosen = null;
  /** @type {AbortController | null} */
  #asking = null;

  /**
   * @param {import("../state.js").State} state
   * @param {import("../time.js").TimeBar} time
   * @param {import("../objects.js").Objects} objects
   * @param {import("../map.js").MapView} map
   */
  constructor(state, time, objects, map) {
    this.state = state;
    this.time = time;
    this.objects = objects;
    this.map = map;
    this.moments = { a: this.#moment("a", "First moment", "1"), b: this.#moment("b", "Second moment", "2") };
    this.result = el("div", { class: "result" });
    byId("panel-compare").append(
      el("h2", { text: "Compare two moments" }),
      this.moments.a.box,
      this.moments.b.box,
      el(
        "div",
        { class: "row" },
        el("button", {
          type: "button",
          id: "compare-clear",
          text: "Clear both",
          click: () => this.state.set({ a: null, b: null }, { push: true }),
        }),
      ),
      this.result,
    );
    state.on(["a", "b"], () => this.load());
    objects.onChange(() => this.#placeMoves());
    this.load();
  }

  async load() {
    this.#asking?.abort();
    const { a, b } = this.state.now;
    byId("compare-clear").hidden = a === null && b === null;
    this.moments.a.show(a);
    this.moments.b.show(b);
    this.changed = this.chosen = null;
    this.map.draw();
    if (a === null || b === null) {
      const next =
        a === null && b === null
          ? "Go to a moment and set it as the first one, then to another and set it as the second."
          : `Now set the ${a === null ? "first" : "second"} moment.`;
      this.result.replaceChildren(el("p", { class: "hint", text: next }));
      return;
    }
    const asking = (this.#asking = new AbortController());
    const wait = (progress) =>
      this.result.replaceChildren(
        el("p", {
          class: "hint waiting",
          role: "status",
          text: progress ? `Looking for objects first: ${percent(progress)}` : "Comparing…",
        }),
      );
    wait(null);
    try {
      const answer = await askUntilReady(
        "/api/diff",
        { a: Math.min(a, b), b: Math.max(a, b) },
        { signal: asking.signal, onWait: wait },
      );
      this.changed = this.#shaped(answer);
      this.#show();
    } catch (error) {
      if (!asking.signal.aborted)
        this.result.replaceChildren(
          el("p", { class: "hint", role: "alert", text: `They cannot be compared: ${error.message}` }),
        );
    }
    this.map.draw();
  }

  #moment(key, title, number) {
    const when = el("span", { class: "moment-text" });
    const set = el("button", {
      type: "button",
      id: `set-${key}`,
      text: "Set to this moment",
      "aria-label": `Set the ${title.toLowerCase()} to the one shown`,
      click: () => this.state.set({ [key]: this.state.now.t }, { push: true }),
    });
    const go = el("button", {
      type: "button",
      id: `go-${key}`,
      text: "Go there",
      "aria-label": `Go to the ${title.toLowerCase()}`,
      click: () => this.time.go(this.state.now[key]),
    });
    const text = el("p", {}, el("strong", { text: title }), when);
    const box = el(
      "div",
      { class: `pick pick-${key}` },
      el("span", { class: "badge", text: number, "aria-hidden": "true" }),
      text,
      el("div", {}, set, go),
    );
    const show = (t) => {
      when.textContent = t === null ? "not set" : offset(t);
      when.title = t === null ? "" : date(this.time.clock, t);
      go.disabled = t === null;
    };
    return { box, show };
  }

  #shaped(answer) {
    const shaped = (patch) => {
      const shape = shapeOf(patch.cells ?? []);
      return { ...patch, shape, bounds: boundsOf(shape.box, this.map.resolution) };
    };
    return {
      ...answer,
      moved: answer.moved.map((move) => ({ ...move })),
      appeared: answer.appeared.map(shaped),
      vanished: answer.vanished.map(shaped),
    };
  }

  /** The ends of each move, when the objects are known. */
  #placeMoves() {
    for (const move of this.changed?.moved ?? []) {
      const one = this.objects.byId(move.object);
      const centre = (id) => one?.states.find((state) => state.place === id)?.centre;
      move.path = [centre(move.from), centre(move.to)].filter(Boolean);
      move.bounds = one?.bounds ?? (move.at ? [move.at[0], move.at[0], move.at[1], move.at[1]] : null);
      move.text = `object ${move.object}: ${this.#placeText(one, move.from)} → ${this.#placeText(one, move.to)}`;
    }
  }

  #placeText(one, id) {
    return one?.states.find((state) => state.place === id)?.letter ?? "elsewhere";
  }

  #show() {
    this.#placeMoves();
    const { moved, appeared, vanished, compared_m2, not_seen_again_m2, brief } = this.changed;
    const patches = (kind) =>
      this.changed[kind].map((patch) => ({
        kind,
        change: patch,
        text: `${place(patch.centre)} m, ${patch.area_m2.toFixed(patch.area_m2 < 1 ? 2 : 1)} m²`,
      }));
    const rows = [
      ...moved.map((change) => ({ kind: "moved", change, text: change.text })),
      ...patches("appeared"),
      ...patches("vanished"),
    ];
    const notes = [
      compared_m2 === undefined ? null : `${compared_m2.toFixed(0)} m² seen at both moments`,
      not_seen_again_m2 ? `${not_seen_again_m2.toFixed(0)} m² not seen again: nobody knows` : null,
      brief ? `${counted(brief, "patch", "patches")} seen too briefly to be listed, as people are` : null,
    ].filter(Boolean);
    this.result.replaceChildren(
      el(
        "p",
        { class: "counts", role: "status" },
        ...["moved", "appeared", "vanished"].map((kind) =>
          el(
            "span",
            { class: `count ${kind}` },
            el("b", { text: SIGNS[kind], "aria-hidden": "true" }),
            ` ${this.changed[kind].length} ${kind}`,
          ),
        ),
      ),
      rows.length
        ? el("ul", { class: "changes" }, ...rows.slice(0, MOST_ROWS).map((row) => this.#row(row)))
        : el("p", { class: "hint", text: "Nothing that was seen at both moments differs." }),
      ...(rows.length > MOST_ROWS
        ? [el("p", { class: "quiet", text: `${rows.length - MOST_ROWS} more are drawn on the map.` })]
        : []),
      ...notes.map((text) => el("p", { class: "quiet", text })),
    );
  }

  #row({ kind, change, text }) {
    const choose = () => {
      this.chosen = change;
      for (const other of this.result.querySelectorAll("[aria-current]")) other.removeAttribute("aria-current");
      button.setAttribute("aria-current", "true");
      if (change.bounds) this.map.reveal(change.bounds);
      this.map.draw();
    };
    const button = el(
      "button",
      { type: "button", click: choose },
      el("b", { class: `sign ${kind}`, text: SIGNS[kind], "aria-hidden": "true" }),
      el("strong", { text: kind }),
      el("small", { text }),
    );
    return el("li", {}, button);
  }
}
