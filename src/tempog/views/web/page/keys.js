/** Keys that work everywhere on the page. */

import { byId } from "./dom.js";
import { toggleLayer } from "./panel/layers.js";
import { switchTheme } from "./theme.js";

/**
 * @param {{state: import("./state.js").State, time: import("./time.js").TimeBar, map: import("./map.js").MapView,
 *          openTab: (name: string) => void, toggleHelp: () => void, layers: any[]}} page
 */
export function setUpKeys({ state, time, map, openTab, toggleHelp, layers }) {
  const tab = (name) => () => {
    openTab(name);
    byId(`tab-${name}`).focus();
  };
  const actions = {
    " ": () => time.togglePlay(),
    p: () => time.stepTo(-1),
    n: () => time.stepTo(1),
    "<": () => time.changeSpeed(-1),
    ">": () => time.changeSpeed(1),
    l: tab("layers"),
    o: tab("objects"),
    x: tab("cell"),
    c: tab("compare"),
    "[": () => state.set({ a: state.now.t }, { push: true }),
    "]": () => state.set({ b: state.now.t }, { push: true }),
    "/": () => search(state, openTab),
    d: switchTheme,
    "?": toggleHelp,
    0: () => map.fit(),
    "+": () => map.zoomBy(1.5),
    "-": () => map.zoomBy(1 / 1.5),
    Escape: () => close(state),
  };
  layers.forEach((layer, k) => (actions[String(k + 1)] = () => toggleLayer(state, layer.id)));
  addEventListener("keydown", (event) => {
    const at = /** @type {HTMLElement} */ (event.target);
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || at.closest("dialog")) return;
    if (at.matches("input[type=text], input[type=search], select")) {
      if (event.key === "Escape") at.blur();
      return;
    }
    if (event.key === " " && at.matches("button, a, summary, input[type=checkbox]")) return; // it presses them
    const act = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
  for (const link of document.querySelectorAll("[data-skip]")) {
    link.addEventListener("click", (event) => {
      event.preventDefault(); // the address holds the view
      byId(/** @type {HTMLElement} */ (link).dataset.skip).focus();
    });
  }
}

function search(state, openTab) {
  state.set({ object: null });
  openTab("objects");
  byId("object-search").focus();
}

function close(state) {
  if (state.now.object !== null) state.set({ object: null }, { push: true });
  else if (state.now.cell) state.set({ cell: null }, { push: true });
  else if (state.now.a !== null || state.now.b !== null) state.set({ a: null, b: null }, { push: true });
}
