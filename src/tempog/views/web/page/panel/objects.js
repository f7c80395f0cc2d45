/** The list of objects: sorted by any column, searched by number, kind or place. */

import { el, icon, swatch } from "../dom.js";
import { count, counted, offset, percent, place } from "../format.js";
import { placeName, whereabouts } from "../objects.js";

const MOST_ROWS = 150; // more are drawn when asked for
const COLUMNS = [
  { id: "id", title: "No.", key: (one) => one.id },
  { id: "now", title: "Then", key: (one, t) => stateText(one, t) },
  { id: "moves", title: "Moves", key: (one) => -one.n_moves },
  { id: "last", title: "Last move", key: (one) => -lastMove(one) },
  { id: "sure", title: "Sure", key: (one) => -(one.confidence ?? -1) },
];

export class ObjectList {
  #sort = "moves";
  #reverse = false;
  #rows = MOST_ROWS;
  #query = "";

  /**
   * @param {HTMLElement} box
   * @param {import("../state.js").State} state
   * @param {import("../objects.js").Objects} objects
   * @param {(id: number) => void} choose
   */
  constructor(box, state, objects, choose) {
    this.box = box;
    this.state = state;
    this.objects = objects;
    this.choose = choose;
    this.search = el("input", {
      type: "search",
      id: "object-search",
      placeholder: "Search: number or place",
      "aria-label": "Search objects",
      autocomplete: "off",
      input: () => this.#find(),
    });
    this.summary = el("p", { class: "quiet", role: "status" });
    this.table = el("table", { class: "list" });
    this.more = el("button", { type: "button", text: "Show more", click: () => this.#showMore() });
    this.hint = el("p", { class: "quiet", text: "With ?: not in view then, and last seen there." });
    this.warning = el("p", { class: "warning", hidden: true });
    this.box.append(this.search, this.summary, this.warning, this.table, this.more, this.hint);
    this.show();
  }

  show() {
    const { status, all, error, progress, places } = this.objects;
    const found = all.filter((one) => matches(one, this.#query));
    this.search.hidden = !all.length;
    const lone = places.length ? `, ${counted(places.length, "lone place")}` : "";
    this.summary.textContent = {
      working: `Looking for objects${progress ? `: ${percent(progress)}` : "…"}`,
      failed: `Objects could not be found: ${error}`,
      away: "The server does not answer; objects come when it is back.",
      ready: !all.length
        ? `No objects were found: nothing was seen to move between places that it returns to${lone}.`
        : this.#query
          ? `${found.length} of ${counted(all.length, "object")}`
          : `${counted(all.length, "object")}${lone}`,
    }[status];
    this.summary.classList.toggle("waiting", status === "working");
    this.table.hidden = this.hint.hidden = !found.length;
    const focused = document.activeElement?.id;
    const sorted = this.#sorted(found);
    this.table.replaceChildren(
      this.#head(),
      el("tbody", {}, ...sorted.slice(0, this.#rows).map((one) => this.#row(one))),
    );
    if (focused && this.table.contains(document.getElementById(focused))) document.getElementById(focused).focus();
    this.more.hidden = found.length <= this.#rows;
    this.more.textContent = `Show ${count(Math.min(MOST_ROWS, found.length - this.#rows))} more`;
  }

  /** What is said about the poses, if they cannot be trusted. @param {string | null} poses */
  note(poses) {
    this.warning.hidden = !poses?.includes("inconsistent");
    this.warning.textContent = poses ? `${poses[0].toUpperCase()}${poses.slice(1)}.` : "";
  }

  /** The states at another moment. */
  refresh() {
    const t = this.state.now.t ?? 0;
    for (const cell of this.table.querySelectorAll("[data-now]")) {
      const one = this.objects.byId(Number(/** @type {HTMLElement} */ (cell).dataset.now));
      const text = one ? stateText(one, t) : "";
      if (cell.textContent !== text) cell.textContent = text;
    }
  }

  #find() {
    this.#query = this.search.value.trim().toLowerCase();
    this.#rows = MOST_ROWS;
    this.show();
  }

  #showMore() {
    this.#rows += MOST_ROWS;
    this.show();
  }

  #sorted(found) {
    const { key } = COLUMNS.find((column) => column.id === this.#sort);
    const t = this.state.now.t ?? 0;
    const sign = this.#reverse ? -1 : 1;
    const compare = (one, other) => (typeof one === "string" ? one.localeCompare(other) : one - other);
    return [...found].sort((one, other) => sign * compare(key(one, t), key(other, t)) || one.id - other.id);
  }

  #head() {
    return el(
      "thead",
      {},
      el(
        "tr",
        {},
        ...COLUMNS.map(({ id, title }) => {
          const chosen = id === this.#sort;
          const downwards = this.#reverse !== ["moves", "last", "sure"].includes(id);
          const order = chosen ? (downwards ? "descending" : "ascending") : "none";
          const sort = () => {
            this.#reverse = chosen && !this.#reverse;
            this.#sort = id;
            this.show();
          };
          const mark = el("span", {
            class: "order",
            "aria-hidden": "true",
            text: !chosen ? "" : downwards ? "▾" : "▴",
          });
          return el(
            "th",
            { "aria-sort": order, class: `col-${id}`, scope: "col" },
            el("button", { type: "button", id: `sort-${id}`, click: sort }, title, mark),
          );
        }),
      ),
    );
  }

  #row(one) {
    const t = this.state.now.t ?? 0;
    const name = el(
      "button",
      {
        type: "button",
        class: "name",
        id: `object-${one.id}`,
        click: () => this.choose(one.id),
        "aria-label": `Object ${one.id} at ${place(one.centre)} metres`,
      },
      swatch(one.colour),
      String(one.id),
      el("small", { text: place(one.centre) }),
    );
    return el(
      "tr",
      {
        class: one.id === this.state.now.object ? "chosen" : "",
        click: (event) => event.target.closest("button") || this.choose(one.id),
      },
      el("th", { scope: "row" }, name),
      el("td", { "data-now": one.id, text: stateText(one, t) }),
      el("td", { class: "number", text: count(one.n_moves) }),
      el("td", { class: "number", text: one.n_moves ? offset(lastMove(one), false) : "–" }),
      el("td", { class: "number", text: percent(one.confidence) }),
    );
  }
}

/** A button that goes back to the list. @param {() => void} click */
export function backButton(click) {
  return el("button", { type: "button", class: "back", id: "back-to-list", click }, icon("back"), "All objects");
}

function stateText(one, t) {
  const { known, place: id } = whereabouts(one, t);
  if (known === "unknown") return "not seen yet";
  return known === "seen" ? placeName(one, id) : `${placeName(one, id)}?`;
}

function lastMove(one) {
  const stays = one.stays ?? [];
  return stays.length > 1 ? stays[stays.length - 1][0] : -Infinity;
}

function matches(one, query) {
  if (!query) return true;
  const texts = [
    String(one.id),
    `object ${one.id}`,
    one.kind ?? "",
    place(one.centre),
    ...one.states.map((state) => place(state.centre)),
  ];
  return texts.some((text, k) => (k === 0 ? text.startsWith(query) : text.toLowerCase().includes(query)));
}
