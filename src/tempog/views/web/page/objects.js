/** What was found: objects with their places, asked from the server, and where each was when. */

import { askUntilReady, Unreachable } from "./api.js";
import { around, boundsOf, shapeOf } from "./cells.js";
import { letter } from "./format.js";
import { objectColour } from "./theme.js";

const GAP_S = 1; // shorter, some beams missed what was in view

/**
 * @typedef {Object} Whereabouts
 * @property {"seen" | "last" | "unknown"} known  seen there then, last seen there, or not seen yet
 * @property {number | null} place  id; null: in none of them
 * @property {number} since  seconds; since when it is there, or when it was last seen there
 */

export class Objects {
  /** @type {any[]} */
  all = [];
  /** @type {any[]} lone places, of no object */
  places = [];
  /** @type {"working" | "ready" | "failed" | "away"} */
  status = "working";
  /** @type {number | null} */
  progress = null;
  tz = "UTC";
  dated = true;
  error = "";
  #listeners = new Set();
  /** @type {AbortController | null} */
  #asking = null;

  /** @param {number} resolution metres */
  constructor(resolution) {
    this.resolution = resolution;
  }

  /** @param {() => void} listener */
  onChange(listener) {
    this.#listeners.add(listener);
  }

  /** Ask for all of it, for a version of the map. @param {number | string} version */
  async load(version) {
    this.#asking?.abort();
    const asking = (this.#asking = new AbortController());
    const onWait = (progress) => this.#tell({ progress, status: this.all.length ? this.status : "working" });
    try {
      const answer = await askUntilReady("/api/objects", { v: version }, { signal: asking.signal, onWait });
      if (!asking.signal.aborted) this.#take(answer);
    } catch (error) {
      if (asking.signal.aborted) return;
      this.#tell({ status: error instanceof Unreachable ? "away" : "failed", error: error.message });
    }
  }

  /** @param {number | null} id */
  byId(id) {
    return this.all.find((one) => one.id === id) ?? null;
  }

  /** The object at a point, the smallest if there are several. @param {number} x @param {number} y @param {number} reach metres */
  at(x, y, reach) {
    const near = (state) => {
      const steps = Math.ceil(reach / this.resolution);
      const [row, col] = [Math.floor(y / this.resolution), Math.floor(x / this.resolution)];
      const [c0, c1, r0, r1] = state.shape.box;
      if (col < c0 - steps || col > c1 + steps || row < r0 - steps || row > r1 + steps) return false;
      for (let up = -steps; up <= steps; up++) {
        for (let right = -steps; right <= steps; right++)
          if (state.shape.here.has(`${row + up} ${col + right}`)) return true;
      }
      return false;
    };
    const hits = this.all.filter((one) => one.states.some(near));
    return hits.sort((one, other) => one.n_cells - other.n_cells)[0] ?? null;
  }

  #take(answer) {
    const withShape = (state) => ({ ...state, shape: shapeOf(state.cells) });
    this.all = answer.objects.map((one, k) => {
      const states = one.states.map((state, n) => ({ ...withShape(state), letter: letter(n) }));
      const box = around(states.map((state) => state.shape.box));
      const middle = states.map((state) => state.centre);
      return {
        ...one,
        k,
        states,
        get colour() {
          return objectColour(k);
        },
        bounds: boundsOf(box, this.resolution),
        n_cells: states.reduce((sum, state) => sum + state.cells.length, 0),
        centre: [0, 1].map(
          (axis) => middle.reduce((sum, point) => sum + point[axis], 0) / Math.max(middle.length, 1),
        ),
      };
    });
    this.places = (answer.places ?? []).map(withShape);
    this.#tell({ status: "ready", progress: null, tz: answer.tz ?? "UTC", dated: answer.dated ?? true });
  }

  #tell(changes) {
    Object.assign(this, changes);
    for (const listener of this.#listeners) listener();
  }
}

/**
 * Where an object was at a moment.
 * @param {any} one
 * @param {number} t
 * @returns {Whereabouts}
 */
export function whereabouts(one, t) {
  const period = latest(one.timeline, t);
  if (!period) return { known: "unknown", place: null, since: 0 };
  const stay = latest(one.stays ?? one.timeline, t);
  if (t <= period[1] + GAP_S)
    return { known: "seen", place: period[2], since: stay && stay[2] === period[2] ? stay[0] : period[0] };
  if (!stay) return { known: "last", place: period[2], since: period[1] };
  const there = one.timeline.findLast(([start, , place]) => start <= t && place === stay[2]);
  return { known: "last", place: stay[2], since: there ? Math.min(there[1], t) : stay[0] };
}

/** The name of a place of an object: its letter. @param {any} one @param {number | null} place */
export function placeName(one, place) {
  const state = one.states.find((other) => other.place === place);
  return state ? state.letter : one.states.length > 1 ? "between places" : "away";
}

/** Moments at which an object came into another state. @param {any} one @returns {number[]} */
export function changesOf(one) {
  return (one.stays ?? one.timeline).slice(1).map(([start]) => start);
}

/** The last period that began by a moment. @param {any[]} periods @param {number} t */
function latest(periods, t) {
  let [low, high] = [0, periods.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (periods[middle][0] <= t) low = middle + 1;
    else high = middle;
  }
  return low ? periods[low - 1] : null;
}
