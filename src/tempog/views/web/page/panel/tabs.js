/** The panel's tabs, by mouse and keys, and folding it away. */

import { byId } from "../dom.js";

export const TABS = ["layers", "objects", "cell", "compare"];

/** @param {import("../state.js").State} state */
export function setUpTabs(state) {
  const fold = byId("fold");
  const setFolded = (folded) => {
    document.body.classList.toggle("folded", folded);
    fold.setAttribute("aria-expanded", String(!folded));
    fold.setAttribute("aria-label", folded ? "Unfold the panel" : "Fold the panel");
  };
  for (const name of TABS) {
    const tab = byId(`tab-${name}`);
    tab.addEventListener("click", () => {
      if (state.now.tab === name && document.body.classList.contains("folded")) setFolded(false);
      open(name);
    });
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      const next = TABS[(TABS.indexOf(name) + step + TABS.length) % TABS.length];
      open(next);
      byId(`tab-${next}`).focus();
    });
  }
  fold.addEventListener("click", () => setFolded(!document.body.classList.contains("folded")));
  const open = (name) => {
    setFolded(false);
    state.set({ tab: name });
  };
  const show = () => {
    for (const name of TABS) {
      const chosen = state.now.tab === name;
      byId(`tab-${name}`).setAttribute("aria-selected", String(chosen));
      byId(`tab-${name}`).tabIndex = chosen ? 0 : -1;
      byId(`panel-${name}`).hidden = !chosen;
    }
  };
  state.on(["tab"], show);
  show();
  const isBelow = getComputedStyle(document.body).gridTemplateColumns.split(" ").length === 1; // the map, not beside it
  if (isBelow && state.now.tab === "layers") setFolded(true);
  return open;
}
