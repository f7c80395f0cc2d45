/** What the page shows, held by its address, so that a link shows the same. */

/**
 * @typedef {Object} Values
 * @property {number | null} x     middle of the view, metres
 * @property {number | null} y
 * @property {number | null} z     pixels per metre
 * @property {number | null} t     seconds from the map's first scan
 * @property {boolean} follow      stay at the newest moment
 * @property {Record<string, number>} layers   opacity of each layer that is shown
 * @property {number | null} hold  seconds that a cell keeps its last known state; null: for ever
 * @property {number | null} object
 * @property {[number, number] | null} cell    a point in it, metres
 * @property {number | null} a     the moments to compare
 * @property {number | null} b
 * @property {string} tab
 */

export const DEFAULT_LAYERS = { occupancy: 1, age: 0.6, objects: 0.9 };
const ADDRESS_AFTER_MS = 250; // browsers refuse pages that rewrite their address all the time

/** @returns {Values} */
export function defaults() {
  return {
    x: null,
    y: null,
    z: null,
    t: null,
    follow: true,
    layers: { ...DEFAULT_LAYERS },
    hold: null,
    object: null,
    cell: null,
    a: null,
    b: null,
    tab: "layers",
  };
}

/** The values, who wants to know of changes, and the address. */
export class State {
  /** @type {Values} */
  #values = defaults();
  /** @type {{keys: string[], listener: (changed: Set<string>) => void}[]} */
  #listeners = [];
  #timer = 0;

  constructor() {
    this.#values = { ...defaults(), ...parseHash(location.hash) };
    addEventListener("popstate", () => this.set({ ...this.#whereFrom(), ...parseHash(location.hash) }));
  }

  get now() {
    return this.#values;
  }

  /**
   * Call a listener after any of some values changed.
   * @param {string[]} keys
   * @param {(changed: Set<string>) => void} listener
   */
  on(keys, listener) {
    this.#listeners.push({ keys, listener });
  }

  /**
   * Change values. `push` makes the browser's back button return to what was before.
   * @param {Partial<Values>} changes
   * @param {{push?: boolean}} [how]
   */
  set(changes, { push = false } = {}) {
    const changed = new Set();
    for (const [key, value] of Object.entries(changes)) {
      if (same(this.#values[key], value)) continue;
      if (push && !changed.size) this.#write(); // where back leads is complete
      this.#values = { ...this.#values, [key]: value };
      changed.add(key);
    }
    if (!changed.size) return;
    if (push) this.#write(true);
    else this.#timer ||= window.setTimeout(() => this.#write(), ADDRESS_AFTER_MS);
    for (const { keys, listener } of this.#listeners) if (keys.some((key) => changed.has(key))) listener(changed);
  }

  #whereFrom() {
    const { x, y, z, t } = this.#values; // an address without them leaves the view alone
    return { ...defaults(), x, y, z, t };
  }

  /** @param {boolean} [push] */
  #write(push = false) {
    clearTimeout(this.#timer);
    this.#timer = 0;
    const hash = formatHash(this.#values);
    if (hash === location.hash) return;
    if (push) history.pushState(null, "", hash);
    else history.replaceState(null, "", hash);
  }
}

/**
 * @param {Values} values
 * @returns {string}
 */
export function formatHash(values) {
  const parts = [];
  const add = (name, value) => value !== null && parts.push(`${name}=${value}`);
  const fixed = (value, digits) => (value === null ? null : String(Number(value.toFixed(digits))));
  add("x", fixed(values.x, 3));
  add("y", fixed(values.y, 3));
  add("z", fixed(values.z, 3));
  add("t", values.follow ? "now" : fixed(values.t, 3));
  const layers = Object.entries(values.layers).map(([id, opacity]) => `${id}:${Number(opacity.toFixed(2))}`);
  add("layers", layers.join(","));
  add("hold", fixed(values.hold, 1));
  add("object", values.object);
  add("cell", values.cell && `${fixed(values.cell[0], 3)},${fixed(values.cell[1], 3)}`);
  add("a", fixed(values.a, 3));
  add("b", fixed(values.b, 3));
  add("tab", values.tab === "layers" ? null : values.tab);
  return `#${parts.join("&")}`;
}

/**
 * What an address asks for; what is malformed is left out.
 * @param {string} hash
 * @returns {Partial<Values>}
 */
export function parseHash(hash) {
  const params = new URLSearchParams(hash.replace(/^#/, ""));
  /** @type {Partial<Values>} */
  const values = {};
  for (const key of /** @type {const} */ (["x", "y", "z", "a", "b", "hold"])) {
    const value = number(params.get(key));
    if (value !== null) values[key] = value;
  }
  if (values.z !== undefined && !(values.z > 0)) delete values.z;
  if (values.hold < 0) delete values.hold;
  const t = number(params.get("t"));
  if (t !== null) Object.assign(values, { t, follow: false });
  else if (params.get("t") === "now") values.follow = true;
  if (params.has("layers")) {
    values.layers = {};
    for (const part of params.get("layers").split(",")) {
      const [id, opacity] = part.split(":");
      if (/^[a-z][a-z0-9-]*$/.test(id)) values.layers[id] = Math.min(1, Math.max(0, number(opacity) ?? 1));
    }
  }
  const object = number(params.get("object"));
  if (object !== null) Object.assign(values, { object, tab: "objects" });
  const cell = (params.get("cell") ?? "").split(",").map(number);
  if (cell.length === 2 && cell[0] !== null && cell[1] !== null) {
    Object.assign(values, { cell, tab: object === null ? "cell" : "objects" });
  }
  if (values.a !== undefined && values.b !== undefined && object === null) values.tab ??= "compare";
  if (["layers", "objects", "cell", "compare"].includes(params.get("tab"))) values.tab = params.get("tab");
  return values;
}

/** @param {string | null | undefined} text */
function number(text) {
  if (text === null || text === undefined || text.trim() === "") return null;
  const value = Number(text);
  return Number.isFinite(value) ? value : null;
}

/** @param {any} one @param {any} other */
function same(one, other) {
  return (
    one === other ||
    (typeof one === "object" && typeof other === "object" && JSON.stringify(one) === JSON.stringify(other))
  );
}
