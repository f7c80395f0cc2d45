/** One object: where it is, its timeline with what nobody saw, when it is where, and every change. */

import { el, icon, swatch } from "../dom.js";
import { counted, date, duration, offset, percent, place } from "../format.js";
import { placeName, whereabouts } from "../objects.js";
import { Strip } from "../strip.js";
import { colours } from "../theme.js";
import { backButton } from "./objects.js";

const MOST_CHANGES = 100;
const PALER = [1, 0.45, 0.2, 0.7, 0.32]; // how much of the object's colour each place has, in charts
const DAYS = ["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"];

/**
 * @typedef {Object} Context
 * @property {import("../state.js").State} state
 * @property {import("../time.js").TimeBar} time
 * @property {import("../objects.js").Objects} objects
 * @property {import("../map.js").MapView} map
 */

/** Fill a box with an object; returns what to call when the moment changes. @param {HTMLElement} box @param {any} one @param {Context} context */
export function showObject(box, one, { state, time, objects, map }) {
  const now = el("p", { class: "now" });
  const canvas = el("canvas", { class: "strip tall", role: "img", "aria-label": timelineText(one) });
  const changes = changeList(one, time);
  const cell = el("button", {
    type: "button",
    class: "link",
    text: "History of the cell that was clicked",
    click: () => state.set({ tab: "cell" }, { push: true }),
  });
  const parts = [
    backButton(() => state.set({ object: null }, { push: true })),
    el(
      "div",
      { class: "heading" },
      swatch(one.colour),
      el("h2", { text: `Object ${one.id}` }),
      one.kind ? el("span", { class: "quiet", text: one.kind }) : null,
      el(
        "button",
        {
          type: "button",
          class: "tool",
          title: "Show it on the map",
          "aria-label": "Show it on the map",
          click: () => map.reveal(one.bounds),
        },
        icon("target"),
      ),
    ),
    now,
    el(
      "dl",
      { class: "facts" },
      ...fact("Moves", String(one.n_moves)),
      ...fact("Places", String(one.states.length)),
      ...fact("Sure", percent(one.confidence)),
    ),
    el("h3", { text: "When it was where" }),
    canvas,
    el("p", { class: "key" }, ...keyOf(one)),
    placeTable(one),
    ...(objects.dated
      ? [
          chart(
            "Share by hour",
            one,
            one.by_hour,
            Array.from({ length: 24 }, (_, k) => (k % 6 ? "" : String(k))),
            (k) => `${k}:00`,
            objects.tz,
          ),
          chart("Share by weekday", one, one.by_weekday, DAYS, (k) => DAYS[k], objects.tz),
        ]
      : []),
    el("h3", { text: `${counted(one.n_moves, "change")}` }),
    changes.list,
    state.now.cell ? cell : null,
  ];
  box.replaceChildren(...parts.filter((part) => part !== null));
  const strip = new Strip(canvas, { axis: () => time.axis, moment: () => state.now.t ?? 0, go: (t) => time.go(t) });
  const drawStrip = () => strip.show(bandsOf(one));
  drawStrip();
  const refresh = () => {
    now.replaceChildren(...nowText(one, state.now.t ?? 0));
    changes.mark(state.now.t ?? 0);
    drawStrip();
  };
  refresh();
  return refresh;
}

function nowText(one, t) {
  const { known, place: id, since } = whereabouts(one, t);
  const where = el("strong", { text: id === null ? placeName(one, id) : `place ${placeName(one, id)}` });
  if (known === "unknown") return ["Not seen yet at this moment."];
  if (known === "seen") return ["At ", where, `, since ${offset(since)}.`];
  return ["Last seen at ", where, `, ${duration(Math.max(0, t - since))} before: not in view then.`];
}

function bandsOf(one) {
  const n = one.states.length;
  return one.timeline.flatMap(([from, to, id]) => {
    const k = one.states.findIndex((state) => state.place === id);
    if (k < 0) return [{ from, to, fill: colours().strip_pale }];
    return [
      { from, to, fill: colours().ground },
      { from, to, fill: one.colour, top: k / n + 0.02, bottom: (k + 1) / n - 0.02 },
    ].map((band, at) => (at ? band : { ...band, top: 0 }));
  });
}

function keyOf(one) {
  const rows = one.states.length > 1 ? `one row a place, ${one.states[0].letter} on top` : "filled: there";
  const away = one.states.length > 1 ? "between" : "away";
  const signs = [
    [swatch(one.colour), rows],
    [swatch(colours().strip_pale), away],
    [swatch(colours().gap, "hatched"), "nobody looked"],
  ];
  return signs.map((sign) => el("span", {}, ...sign));
}

function timelineText(one) {
  const gaps = one.gaps ?? [];
  const unseen = gaps.reduce((sum, [from, to]) => sum + to - from, 0);
  return `Timeline of object ${one.id}: ${counted(one.n_moves, "move")}, ${counted(gaps.length, "gap")} of ${duration(unseen)} in which nobody looked; listed below`;
}

function placeTable(one) {
  const rows = one.states.map((state) =>
    el(
      "tr",
      {},
      el("th", { scope: "row", text: state.letter }),
      el("td", { text: `${place(state.centre)} m` }),
      el("td", { class: "number", text: percent(one.shares?.[state.place]) }),
      el("td", { class: "quiet", text: state.hypothesis ? "supposed" : "" }),
    ),
  );
  const between = one.shares?.none;
  if (between)
    rows.push(
      el(
        "tr",
        {},
        el("th", { scope: "row", text: "–" }),
        el("td", { text: one.states.length > 1 ? "between places" : "away" }),
        el("td", { class: "number", text: percent(between) }),
        el("td"),
      ),
    );
  return el(
    "table",
    { class: "places" },
    el(
      "thead",
      {},
      el("tr", {}, ...["Place", "Where", "Share of time seen", ""].map((text) => el("th", { scope: "col", text }))),
    ),
    el("tbody", {}, ...rows),
  );
}

function fact(name, value) {
  return [el("dt", { text: name }), el("dd", { text: value })];
}

/** Bars of the share in each place; hatched where it was not seen. */
function chart(title, one, shares, ticks, name, zone) {
  if (!shares) return null;
  const bars = ticks.map((tick, k) => {
    const values = one.states.map((state) => shares[state.place]?.[k] ?? null);
    const seen = values.some((value) => value !== null);
    const text = seen ? one.states.map((state, n) => `${state.letter} ${percent(values[n])}`).join(", ") : "not seen";
    const bar = el("div", { class: seen ? "bar" : "bar unseen-bar", title: `${name(k)}: ${text}` });
    values.forEach((value, n) => {
      const part = el("span");
      part.style.height = `${(value ?? 0) * 100}%`;
      part.style.background = `color-mix(in srgb, ${one.colour} ${PALER[n % PALER.length] * 100}%, var(--ground))`;
      bar.append(part);
    });
    return {
      column: el("div", { class: "column" }, bar, el("span", { class: "tick", text: tick })),
      text: `${name(k)} ${text}`,
      seen,
    };
  });
  const summary = bars
    .filter((bar) => bar.seen)
    .map((bar) => bar.text)
    .join("; ");
  const key = one.states
    .slice(0, PALER.length)
    .map((state, n) =>
      el("span", {}, swatch(`color-mix(in srgb, ${one.colour} ${PALER[n] * 100}%, var(--ground))`), state.letter),
    );
  return el(
    "figure",
    { class: "chart" },
    el("figcaption", {}, `${title}, ${zone}`, el("span", { class: "key" }, ...key)),
    el(
      "div",
      { class: "bars", role: "img", "aria-label": `${title}: ${summary || "never seen"}` },
      ...bars.map((bar) => bar.column),
    ),
  );
}

/** A button for each change, which goes there. */
function changeList(one, time) {
  const stays = one.stays ?? [];
  const from = Math.max(0, stays.length - MOST_CHANGES);
  const buttons = stays.slice(from).map(([start, stop, id, seen], k) => {
    const lasted = `stayed ${duration(stop - start)}${seen !== undefined && stop - start - seen > 1 ? `, seen for ${duration(seen)}` : ""}`;
    return {
      start,
      button: el(
        "button",
        { type: "button", click: () => time.go(start), title: date(time.clock, start) },
        el("span", { class: "when", text: offset(start) }),
        el("strong", { text: from + k ? `→ ${placeName(one, id)}` : placeName(one, id) }),
        el("small", { text: lasted }),
      ),
    };
  });
  const list = el("ol", { class: "changes" }, ...buttons.map(({ button }) => el("li", {}, button)));
  if (from) list.prepend(el("li", { class: "quiet", text: `${counted(from, "earlier change")} not listed` }));
  const mark = (t) => {
    const current = buttons.findLast(({ start }) => start <= t);
    for (const each of buttons) {
      if (each === current) each.button.setAttribute("aria-current", "true");
      else each.button.removeAttribute("aria-current");
    }
  };
  return { list, mark };
}
