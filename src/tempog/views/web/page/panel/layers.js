/** The panel of layers: which are shown, how strongly, and what their colours mean. */

import { byId, el, swatch } from "../dom.js";
import { colours, objectColour, themeName } from "../theme.js";

/** From the lowest to the topmost, with what they show. */
export const LAYERS = {
  occupancy: ["Occupancy", "things and free floor, as known then"],
  static: ["Static map", "what never moves"],
  age: ["Age", "fades what was not seen for long"],
  dynamics: ["Dynamics", "where much changes"],
  people: ["Where people walk", "over the whole time"],
  "people-now": ["People then", "what is on the move then"],
  objects: ["Objects", "in the state they had then"],
};
const HOLDS = [
  [null, "for ever"],
  [3600, "for an hour"],
  [600, "for 10 minutes"],
  [60, "for a minute"],
  [10, "for 10 seconds"],
  [0, "only while seen"],
];

/** Layers of the server in the page's order, objects among them. @param {any[]} layers */
export function ordered(layers) {
  const known = Object.keys(LAYERS);
  const rank = (layer) => (known.indexOf(layer.id) + known.length + 1) % (known.length + 1);
  const all = layers.some((layer) => layer.id === "objects")
    ? layers
    : [...layers, { id: "objects", kind: "moment", legend: [] }];
  return [...all].sort((one, other) => rank(one) - rank(other));
}

/**
 * @param {import("../state.js").State} state
 * @param {{layers: any[], live: boolean}} facts
 * @param {import("../objects.js").Objects} objects
 */
export function setUpLayers(state, { layers, live }, objects) {
  const rows = layers.map((layer) => row(state, layer)).reverse();
  const hold = el(
    "select",
    { id: "hold", change: () => state.set({ hold: hold.value === "" ? null : Number(hold.value) }) },
    ...HOLDS.map(([seconds, text]) => el("option", { value: seconds === null ? "" : String(seconds), text })),
  );
  const all = el("ul", { class: "layers" }, ...rows.map(({ item }) => item));
  byId("panel-layers").append(
    el("h2", { class: "unseen", text: "Layers" }),
    all,
    el("label", { class: "field", for: "hold" }, "A state that was seen counts", hold),
    el("h3", { text: "What the colours mean" }),
    el("ul", { class: "legend-list", id: "legend-panel" }),
  );
  const show = () => {
    for (const { refresh } of rows) refresh();
    hold.value = state.now.hold === null ? "" : String(state.now.hold);
    if (hold.selectedIndex < 0) {
      hold.append(el("option", { value: String(state.now.hold), text: `for ${state.now.hold} s` }));
      hold.value = String(state.now.hold);
    }
    showLegend(state, layers, objects, live);
  };
  objects.onChange(show);
  state.on(["layers", "hold", "tab", ...(live ? ["follow"] : [])], show);
  addEventListener("themechange", show);
  show();
}

/** Show or hide a layer. @param {import("../state.js").State} state @param {string} id */
export function toggleLayer(state, id) {
  const layers = { ...state.now.layers };
  if (layers[id] > 0) delete layers[id];
  else layers[id] = 1;
  state.set({ layers });
}

function row(state, layer) {
  const [title, hint] = LAYERS[layer.id] ?? [layer.title ?? layer.id, ""];
  const [boxId, sliderId] = [`layer-${layer.id}`, `opacity-${layer.id}`];
  let last = 1;
  const box = el("input", { type: "checkbox", id: boxId, change: () => put(box.checked ? last : 0) });
  const slider = el("input", {
    type: "range",
    id: sliderId,
    min: "0",
    max: "1",
    step: "0.05",
    "aria-label": `Opacity of ${title}`,
    input: () => put(Number(slider.value)),
  });
  const put = (opacity) => {
    const layers = { ...state.now.layers };
    if (opacity > 0) layers[layer.id] = opacity;
    else delete layers[layer.id];
    state.set({ layers });
  };
  const refresh = () => {
    const opacity = state.now.layers[layer.id] ?? 0;
    if (opacity > 0) last = opacity;
    box.checked = opacity > 0;
    slider.value = String(opacity);
    slider.setAttribute("aria-valuetext", `${Math.round(opacity * 100)} %`);
    item.classList.toggle("off", opacity === 0);
  };
  const item = el(
    "li",
    { class: "layer" },
    el("label", { for: boxId }, box, el("span", {}, el("strong", { text: title }), el("small", { text: hint }))),
    slider,
  );
  return { item, refresh };
}

function showLegend(state, layers, objects, live) {
  const shown = layers.filter((layer) => state.now.layers[layer.id] > 0);
  const entries = new Map([["unexplored", [colours().unexplored, ""]]]);
  for (const layer of shown) for (const [label, sign] of legendOf(layer, objects)) entries.set(label, sign);
  if (live && state.now.follow) entries.set("somebody, now", [colours().people, "round"]);
  if (state.now.tab === "compare") {
    entries
      .set("appeared", [colours().appeared, ""])
      .set("vanished", [colours().vanished, "hatched"])
      .set("moved", [colours().moved, "arrow"]);
  }
  for (const id of ["legend-entries", "legend-panel"]) {
    byId(id).replaceChildren(
      ...[...entries].map(([label, [colour, kind]]) => el("li", {}, swatch(colour, kind), label)),
    );
  }
}

/** Labels with a colour and the way it is filled. */
function legendOf(layer, objects) {
  if (layer.id === "objects") {
    const colour = objectColour(0);
    return [
      ["object, there then", [colour, ""]],
      ["last seen there", [colour, "hatched"]],
      ["there at other times", [colour, "dashed"]],
      ...(objects.places.length ? [["lone place", [colours().lone, "dashed"]]] : []),
    ];
  }
  const key = themeName() === "dark" ? "colour_dark" : "colour";
  const visible = (colour) => !/^#.{6}00$/.test(colour);
  const prefix = layer.id === "people" ? "somebody came " : "";
  return (layer.legend ?? [])
    .filter((entry) => visible(entry.colour))
    .map((entry) => [prefix + entry.label, [entry[key] ?? entry.colour, ""]]);
}
