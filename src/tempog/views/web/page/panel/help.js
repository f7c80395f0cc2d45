/** Keys, and what is done with them. */

import { byId, el } from "../dom.js";

const KEYS = [
  ["Space", "play and pause"],
  ["< >", "play slower, faster"],
  ["P N", "previous, next change: of the object or cell that is open, or of the map"],
  ["← →", "on the slider: a second back or on; with Shift ten"],
  ["Home End", "on the slider: to the beginning, to the newest moment"],
  ["arrows", "on the map: move it; with Shift farther"],
  ["+ −", "zoom"],
  ["0", "the whole map"],
  ["Enter", "on the map: what is in the middle; with Alt its cell, even where an object is"],
  ["1 to 7", "show and hide a layer, from the lowest"],
  ["L O X C", "panels: layers, objects, cell, compare"],
  ["[ ]", "set the first, the second moment to compare"],
  ["/", "search objects"],
  ["D", "light or dark"],
  ["Esc", "close what is chosen"],
  ["?", "these keys"],
];
const HINTS = [
  "Drag to move the map, turn the wheel or pinch to zoom, double-click to zoom in.",
  "Click an object for its timeline, any other spot for its history. Where an object is, Alt-click or press for long to get the spot.",
  "The address holds all that is shown: copy it to show somebody else the same.",
];

export function setUpHelp() {
  const dialog = /** @type {HTMLDialogElement} */ (byId("help"));
  byId("help-keys").append(
    el(
      "dl",
      { class: "keys" },
      ...KEYS.flatMap(([keys, what]) => [
        el("dt", {}, ...keys.split(" ").map((key) => el("kbd", { text: key }))),
        el("dd", { text: what }),
      ]),
    ),
    ...HINTS.map((text) => el("p", { class: "quiet", text })),
  );
  byId("help-open").addEventListener("click", () => dialog.showModal());
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  return () => (dialog.open ? dialog.close() : dialog.showModal());
}
