/** Pictures of layers, put together from the server's tiles. The newest wish wins; what is shown stays until it is there. */

import { askPicture, Refused, Unreachable } from "./api.js";
import { TileCache } from "./tile_cache.js";

const AGAIN_MS = 1000; // after the server was busy
const OVERTAKEN_MS = 350; // a frame that takes longer gives way to a newer one
const MOST_AT_ONCE = 64; // tiles in one answer

/**
 * @typedef {Object} Frame
 * @property {number} t
 * @property {number | null} hold
 * @property {number | string} version
 * @property {string} theme
 * @property {number} zoom   a tile's pixel is 2**zoom cells
 * @property {[number, number, number, number]} region  first and last column, first and last row of tiles
 * @property {{id: string, kind: string}[]} layers
 * @property {boolean} fleeting  whether time runs: each layer of a moment is asked for as a whole, and not kept
 * @property {number} asked  when, ms
 */

/**
 * @typedef {Object} Part  one answer of the server: some tiles of a layer
 * @property {string} key  its address
 * @property {number} col  the westernmost column, the southernmost row
 * @property {number} row
 * @property {number} cols
 * @property {number} rows
 *
 * @typedef {Object} Picture
 * @property {HTMLCanvasElement} canvas
 * @property {number} zoom
 * @property {[number, number, number, number]} region
 * @property {string} made_of
 */

const NOTHING = /** @type {Frame} */ ({
  t: NaN,
  hold: null,
  version: "",
  theme: "",
  zoom: 0,
  region: [0, -1, 0, -1],
  layers: [],
  fleeting: false,
  asked: 0,
});

/** Loads frames, one at a time, and keeps the picture of each layer. */
export class Pictures {
  cache = new TileCache();
  /** @type {Map<string, Picture>} */
  shown = new Map();
  /** @type {Frame | null} */
  frame = null;
  /** How long the last frame took, ms. */
  tookMs = 0;
  /** @type {{frame: Frame, abort: AbortController} | null} */
  #loading = null;
  /** @type {Frame | null} */
  #next = null;
  /** @type {AbortController | null} */
  #ahead = null;

  /**
   * @param {number} tile_px
   * @param {{onFrame: (frame: Frame) => void, onBusy: (busy: boolean) => void}} listeners
   */
  constructor(tile_px, { onFrame, onBusy }) {
    this.tile_px = tile_px;
    this.onFrame = onFrame;
    this.onBusy = onBusy;
  }

  get busy() {
    return this.#loading !== null;
  }

  /** Ask for a frame; whether it is shown already. @param {Frame} frame */
  want(frame) {
    this.#ahead?.abort();
    const current = this.#loading;
    const awaited = current && !current.abort.signal.aborted ? current.frame : null;
    this.#next = null;
    if (covers((current ? awaited : this.frame) ?? NOTHING, frame)) return !current;
    this.#next = frame;
    if (!current) this.#start();
    else if (
      awaited &&
      (!covers({ ...awaited, t: frame.t }, frame) || performance.now() - awaited.asked > OVERTAKEN_MS)
    ) {
      current.abort.abort();
    }
    return false;
  }

  /** Ask for a layer's tiles again. @param {string} layer */
  forget(layer) {
    this.cache.forget(layer);
    const picture = this.shown.get(layer);
    if (picture) picture.made_of = "";
    if (this.frame?.layers.some(({ id }) => id === layer)) this.frame = null;
    if (!this.#loading) return;
    this.#next ??= this.#loading.frame;
    this.#loading.abort.abort();
  }

  /** Start again after the server was away. */
  retry() {
    if (!this.#loading && this.#next) this.#start();
  }

  async #start() {
    const frame = this.#next;
    if (!frame) return;
    this.#next = null;
    const abort = new AbortController();
    this.#loading = { frame, abort };
    this.onBusy(true);
    const began = performance.now();
    let lost = false;
    try {
      const parts = frame.layers.map((layer) => partsOf(frame, layer));
      const tiles = await Promise.all(
        parts.map((some) => Promise.all(some.map((part) => this.#tile(part, abort.signal)))),
      );
      frame.layers.forEach((layer, k) => this.#compose(frame, layer, parts[k], tiles[k]));
      for (const id of this.shown.keys()) if (!frame.layers.some((layer) => layer.id === id)) this.shown.delete(id);
      this.tookMs = performance.now() - began;
      this.frame = frame;
      this.onFrame(frame);
    } catch (error) {
      lost = error instanceof Unreachable || error instanceof Refused;
      if (error instanceof Refused) setTimeout(() => this.retry(), AGAIN_MS);
      if (lost)
        this.#next ??= frame; // for retry
      else if (!abort.signal.aborted) throw error;
    } finally {
      abort.abort();
      this.cache.trim();
      this.#loading = null;
      this.onBusy(false);
    }
    if (lost) return;
    if (this.#next) this.#start();
    else if (!frame.fleeting) this.#lookAhead(frame);
  }

  /** Tiles around the frame, one after the other, so that panning finds them. @param {Frame} frame */
  async #lookAhead(frame) {
    const abort = new AbortController();
    this.#ahead = abort;
    const [c0, c1, r0, r1] = frame.region;
    const wider = {
      ...frame,
      fleeting: false,
      region: /** @type {[number, number, number, number]} */ ([c0 - 1, c1 + 1, r0 - 1, r1 + 1]),
    };
    try {
      for (const part of frame.layers.flatMap((layer) => partsOf(wider, layer))) {
        if (this.cache.bytes > this.cache.most_bytes / 2) return;
        await this.#tile(part, abort.signal);
      }
    } catch {
      // overtaken by a frame, or the server is away: who asks next will hear of it
    }
  }

  /** @param {Part} part @param {AbortSignal} signal @returns {Promise<ImageBitmap | null>} */
  async #tile({ key, cols, rows }, signal) {
    const known = this.cache.get(key);
    if (known !== undefined) return known;
    const tile = await askPicture(key, signal);
    if (signal.aborted) {
      tile?.close();
      signal.throwIfAborted();
    }
    if (cols * rows === 1 && tile) this.cache.put(key, tile);
    return tile;
  }

  /**
   * Put a layer's picture together.
   * @param {Frame} frame
   * @param {{id: string}} layer
   * @param {Part[]} parts
   * @param {(ImageBitmap | null)[]} tiles
   */
  #compose(frame, layer, parts, tiles) {
    const size = this.tile_px;
    const [c0, c1, r0, r1] = frame.region;
    const [width, height] = [(c1 - c0 + 1) * size, (r1 - r0 + 1) * size];
    const made_of = parts.map((part) => part.key).join(" ");
    const old = this.shown.get(layer.id);
    if (old?.made_of === made_of) return;
    const canvas = old?.canvas ?? document.createElement("canvas");
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    context.clearRect(0, 0, width, height);
    parts.forEach(({ col, row, cols, rows }, k) => {
      if (tiles[k]) context.drawImage(tiles[k], (col - c0) * size, (r1 - row - rows + 1) * size);
      if (cols * rows > 1) tiles[k]?.close(); // what is kept belongs to the cache
    });
    this.shown.set(layer.id, { canvas, zoom: frame.zoom, region: frame.region, made_of });
  }
}

/**
 * What to ask for to get a layer of a frame: one answer while time runs, else its tiles from the north-west on.
 * @param {Frame} frame
 * @param {{id: string, kind: string}} layer
 * @returns {Part[]}
 */
export function partsOf(frame, { id, kind }) {
  const [c0, c1, r0, r1] = frame.region;
  const [n_cols, n_rows] = [c1 - c0 + 1, r1 - r0 + 1];
  const whole = frame.fleeting && kind === "moment" && n_cols * n_rows <= MOST_AT_ONCE;
  const [cols, rows] = whole ? [n_cols, n_rows] : [1, 1];
  const query = new URLSearchParams();
  if (kind === "moment") query.set("t", frame.t.toFixed(3));
  if (kind === "moment" && frame.hold !== null) query.set("hold", String(frame.hold));
  query.set("theme", frame.theme);
  query.set("v", String(frame.version));
  if (cols * rows > 1) {
    query.set("cols", String(cols));
    query.set("rows", String(rows));
  }
  const parts = [];
  for (let row = r1 - rows + 1; row >= r0; row -= rows) {
    for (let col = c0; col <= c1; col += cols) {
      parts.push({ key: `/api/tiles/${id}/${frame.zoom}/${col}/${row}.png?${query}`, col, row, cols, rows });
    }
  }
  return parts;
}

/** What a frame shows but for moment and region. @param {Frame} frame */
function sight(frame) {
  return [frame.version, frame.theme, frame.zoom, frame.hold, ...frame.layers.map((layer) => layer.id)].join(" ");
}

/** Whether a frame shows all that another one is to show. @param {Frame} frame @param {Frame} wanted */
function covers(frame, wanted) {
  const [c0, c1, r0, r1] = frame.region;
  const inside = wanted.region[0] >= c0 && wanted.region[1] <= c1 && wanted.region[2] >= r0 && wanted.region[3] <= r1;
  return inside && frame.t === wanted.t && sight(frame) === sight(wanted);
}
