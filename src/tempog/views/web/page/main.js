/** Puts the page together: the map, its time, what was found, and the address. */

import { byId, el } from "./dom.js";
import { firstFacts, Following } from "./follow.js";
import { counted, duration } from "./format.js";
import { MapView } from "./map.js";
import { Objects, changesOf } from "./objects.js";
import { paintCell, paintChanges, paintCrosshair, paintObjects, paintPeople, paintScaleBar } from "./overlay.js";
import { CellPanel } from "./panel/cell.js";
import { ComparePanel } from "./panel/compare.js";
import { setUpHelp } from "./panel/help.js";
import { setUpLayers } from "./panel/layers.js";
import { showObject } from "./panel/object.js";
import { ObjectList } from "./panel/objects.js";
import { setUpTabs } from "./panel/tabs.js";
import { setUpKeys } from "./keys.js";
import { State } from "./state.js";
import { applyTheme, switchTheme, themeName } from "./theme.js";
import { TimeBar } from "./time.js";

const REACH_PX = 6; // a click so near an object means it
const STEP_ZOOM = 1.5;
const DIMMED = 0.4; // objects, while two moments are compared

/** A line above the map; null takes it away. @param {string | null} text */
function say(text) {
  byId("banner").textContent = text ?? "";
  byId("banner").hidden = text === null;
}

async function start() {
  applyTheme();
  const facts = await firstFacts(say);
  const state = new State();
  if (state.now.t === null) state.set({ t: facts.duration_s });
  const objects = new Objects(facts.resolution_m);
  const near = (x, y) => (state.now.layers.objects ? objects.at(x, y, REACH_PX / map.view.scale) : null);
  const map = new MapView(byId("map"), state, facts, {
    tap: (x, y, deep) => {
      const one = deep ? null : near(x, y);
      state.set({ cell: [x, y], ...(one ? { object: one.id } : {}) }, { push: true });
      openTab(one ? "objects" : "cell");
      map.keepInView(x, y); // the panel may have taken room
    },
    hover: (x, y) => byId("map").classList.toggle("over-object", x !== null && near(x, y) !== null),
    busy: showBusy,
  });
  const time = new TimeBar(state, facts, map);
  const openTab = setUpTabs(state);
  setUpLayers(state, facts, objects);
  const cell = new CellPanel(state, time);
  const compare = new ComparePanel(state, time, objects, map);
  const panel = setUpObjects({ state, time, objects, map });
  const onFacts = (now) => {
    showFacts(now);
    panel.note(now.poses);
  };
  const following = new Following(facts, { time, map, cell, objects, say, onFacts });
  time.steps = () => stepsFor(state, objects, cell);
  map.add((context, view) => paintOver(context, view, { state, map, objects, compare, following }));
  setUpKeys({ state, time, map, openTab, toggleHelp: setUpHelp(), layers: facts.layers });
  setUpBar(state, map);
  for (const event of ["focus", "blur"]) byId("map").addEventListener(event, () => map.draw());
  Object.assign(window, { tempog: { state, map, time, objects, compare } }); // for whoever opens the console
  await following.begin();
  document.body.dataset.ready = "";
}

/** The panel of objects: the list, or the one that is chosen. */
function setUpObjects({ state, time, objects, map }) {
  const list_box = el("div", { class: "object-list" });
  const object_box = el("div", { class: "object-detail" });
  byId("panel-objects").append(el("h2", { class: "unseen", text: "Objects" }), list_box, object_box);
  const list = new ObjectList(list_box, state, objects, (id) => {
    state.set({ object: id, tab: "objects" }, { push: true });
    map.reveal(objects.byId(id).bounds);
  });
  let refresh = () => {};
  let shown = null; // the object's number
  const show = () => {
    const one = objects.byId(state.now.object);
    const focused = document.activeElement;
    const [inList, inObject] = [list_box.contains(focused), object_box.contains(focused)];
    const place = [...object_box.querySelectorAll("button")].indexOf(/** @type {any} */ (focused));
    list_box.hidden = one !== null;
    object_box.hidden = one === null;
    refresh = one ? showObject(object_box, one, { state, time, objects, map }) : () => {};
    if (!one) list.show();
    // Whoever uses keys goes on from where they were.
    if (one && inObject) object_box.querySelectorAll("button")[one.id === shown ? place : 0]?.focus();
    else if (one && inList) byId("back-to-list").focus();
    else if (!one && inObject) (document.getElementById(`object-${shown}`) ?? list.search).focus();
    shown = one?.id ?? null;
    map.draw();
  };
  objects.onChange(show);
  state.on(["object", "tab", "cell"], show);
  addEventListener("themechange", show);
  state.on(["t"], () => {
    list.refresh();
    refresh();
  });
  time.onGrown(() => refresh());
  return { note: (text) => list.note(text) };
}

/** What lies over the layers. */
function paintOver(context, view, { state, map, objects, compare, following }) {
  const { now } = state;
  const present = now.follow ? following.present : null;
  const comparing = now.tab === "compare" && compare.changed !== null;
  const opacity = (now.layers.objects ?? 0) * (comparing ? DIMMED : 1);
  if (opacity > 0) {
    const live = present?.objects ?? null;
    paintObjects(context, view, objects, { t: map.shownT, chosen: now.object, opacity, live, labels: !comparing });
  }
  if (comparing) paintChanges(context, view, compare.changed, map.resolution, compare.chosen);
  if (present) paintPeople(context, view, present.people);
  if (now.cell && now.tab !== "compare") paintCell(context, view, now.cell, map.resolution);
  if (byId("map").matches(":focus-visible")) paintCrosshair(context, view);
  paintScaleBar(context, view);
}

/** The buttons in the bar at the top, and those that zoom. */
function setUpBar(state, map) {
  byId("fit").addEventListener("click", () => map.fit());
  byId("zoom-in").addEventListener("click", () => map.zoomBy(STEP_ZOOM));
  byId("zoom-out").addEventListener("click", () => map.zoomBy(1 / STEP_ZOOM));
  byId("theme").addEventListener("click", switchTheme);
  const save = byId("save");
  const address = () => {
    const query = new URLSearchParams({ format: "png", t: String(state.now.t), theme: themeName() });
    if (state.now.hold !== null) query.set("hold", String(state.now.hold));
    save.href = `/api/snapshot?${query}`;
  };
  state.on(["t", "hold"], address);
  addEventListener("themechange", address);
  address(); // a link without an address is not reached by Tab
}

/** What the map is, in the bar at the top. */
function showFacts(facts) {
  document.title = `${facts.name} · tempog`;
  byId("map-name").textContent = facts.name;
  const parts = [
    counted(facts.n_scans, "scan"),
    duration(facts.duration_s),
    counted(facts.n_cells, "cell"),
    counted(facts.n_intervals, "interval"),
  ];
  byId("map-facts").textContent = parts.join(" · ");
  byId("map-facts").title = [facts.start_iso, facts.poses].filter(Boolean).join("\n");
  byId("live").hidden = !facts.live;
}

/** Steps of the object or cell that is open; null: of the map. */
function stepsFor(state, objects, cell) {
  const one = objects.byId(state.now.object);
  if (state.now.tab === "objects" && one) return changesOf(one);
  if (state.now.tab === "cell" && state.now.cell) return cell.moments;
  return null;
}

let busyTimer = 0;

/** Say that something takes longer. @param {boolean} busy */
function showBusy(busy) {
  clearTimeout(busyTimer);
  if (busy) busyTimer = window.setTimeout(() => (byId("busy").hidden = false), 400);
  else byId("busy").hidden = true;
}

start();
