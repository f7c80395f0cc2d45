/** The map on its canvas: tiles of the layers, and what others paint over them. */

import { fitted, textUnit } from "./dom.js";
import { listen } from "./gestures.js";
import { Pictures } from "./tiles.js";
import { colours, themeName } from "./theme.js";
import { fit, limited, toMap, toScreen, zoomedAt } from "./view.js";

const SHARPER = 0.4; // steps of zoom that tiles may be shown enlarged by, rather than be asked for finer
const MOST_RATIO = 1.5; // finer screens get no finer tiles
const CRISP_PX = 2.5; // from this size on, a tile's pixels are shown as squares
const COARSE_MS = 80; // while time runs, frames slower than this come with half the detail
const EDGE_PX = 40; // a point this near the edge is moved into view
const AROUND_M = 3; // what is shown around a thing that is brought into view
const SETTLED_MS = 160;
const MOST_MEASURES = 1000; // that are kept

/**
 * @typedef {import("./view.js").View} View
 * @typedef {(context: CanvasRenderingContext2D, view: View) => void} Painter
 */

export class MapView {
  /** @type {Painter[]} */
  #painters = [];
  #drawing = 0;
  #settle = 0;
  #movedTime = 0; // when time moved last, ms
  #coarse = false;
  #n_measured = 0;
  #drawn = null; // the frame that was drawn last
  /** When the newest moment was asked for, by the clock of events, ms; for measuring. */
  askedAt = new Map();

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./state.js").State} state
   * @param {any} facts answer of /api/map
   * @param {{tap: (x: number, y: number, deep: boolean) => void, hover: (x: number | null, y: number | null) => void,
   *          busy: (busy: boolean) => void}} handlers
   */
  constructor(canvas, state, facts, { tap, hover, busy }) {
    this.canvas = canvas;
    this.state = state;
    this.facts = facts;
    this.pictures = new Pictures(facts.tile_px, { onFrame: () => this.draw(), onBusy: busy });
    this.resolution = facts.resolution_m;
    listen(canvas, {
      pan: (dx, dy) => this.#look({ x: this.view.x - dx / this.view.scale, y: this.view.y + dy / this.view.scale }),
      zoom: (factor, px, py) => this.zoomBy(factor, px, py),
      tap: (px, py, deep) => tap(...toMap(this.view, px, py), deep),
      hover: (px, py) => (px === null ? hover(null, null) : hover(...toMap(this.view, px, py))),
      fit: () => this.fit(),
    });
    new ResizeObserver(() => this.#show()).observe(canvas);
    state.on(["x", "y", "z", "layers", "hold"], () => this.#show());
    state.on(["t"], () => {
      this.#movedTime = performance.now();
      if (this.#update()) this.draw();
    });
    addEventListener("themechange", () => this.#show());
    if (state.now.z === null || state.now.x === null || state.now.y === null) this.fit();
    else this.#comeBack();
    addEventListener("popstate", () => this.#comeBack());
    this.#show();
  }

  /** @returns {View} */
  get view() {
    const { x, y, z } = this.state.now;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return { x: x ?? 0, y: y ?? 0, scale: z ?? 1, width, height, unit: textUnit() };
  }

  /** Paint something over the layers, in order. @param {Painter} painter */
  add(painter) {
    this.#painters.push(painter);
  }

  /** The map grew, or is another one. @param {any} facts */
  renew(facts) {
    this.facts = facts;
    this.#show();
  }

  /** Show a rectangle; default: all of the map. @param {number[]} [bounds] @param {number} [margin] */
  fit(bounds, margin) {
    const { x, y, scale } = fit(bounds ?? this.facts.bounds, this.view, margin);
    this.#look({ x, y, scale });
  }

  /** Bring a rectangle into view without zooming in more than needed to see it. @param {number[]} bounds */
  reveal([x0, x1, y0, y1]) {
    const { scale, width, height } = this.view;
    const [left, bottom] = toMap(this.view, 40, height - 40);
    const [right, top] = toMap(this.view, width - 40, 40);
    const legible = Math.max(x1 - x0, y1 - y0) * scale > 24;
    if (legible && x0 > left && x1 < right && y0 > bottom && y1 < top) return;
    const wanted = fit([x0 - AROUND_M, x1 + AROUND_M, y0 - AROUND_M, y1 + AROUND_M], this.view, 0.2);
    const enough = scale > wanted.scale || !legible ? wanted.scale : scale;
    this.#look({ x: wanted.x, y: wanted.y, scale: enough });
  }

  /** Move the map as little as it takes to see a point. @param {number} x @param {number} y */
  keepInView(x, y) {
    const { view } = this;
    const [px, py] = toScreen(view, x, y);
    const beyond = (at, size) => Math.min(at - EDGE_PX, 0) + Math.max(at - size + EDGE_PX, 0);
    const [dx, dy] = [beyond(px, view.width), beyond(py, view.height)];
    if (dx || dy) this.#look({ x: view.x + dx / view.scale, y: view.y - dy / view.scale });
  }

  /** @param {number} factor @param {number} [px] @param {number} [py] */
  zoomBy(factor, px = this.view.width / 2, py = this.view.height / 2) {
    const scale = limited(this.view.scale * factor, this.facts.bounds, this.view);
    this.#look(zoomedAt(this.view, scale, px, py));
  }

  /** From a view that somebody wrote in the address, and that shows nothing of the map. */
  #comeBack() {
    this.#look({ scale: limited(this.view.scale, this.facts.bounds, this.view) });
  }

  /** Draw at the next repaint. */
  draw() {
    this.#drawing ||= requestAnimationFrame(() => {
      this.#drawing = 0;
      this.#paint();
    });
  }

  /** Whether what is wanted is what is shown. */
  get settled() {
    const { frame } = this.pictures;
    return !this.pictures.busy && !this.#drawing && !this.#coarse && frame?.t === this.state.now.t;
  }

  /** @param {{x?: number, y?: number, scale?: number}} to */
  #look({ x, y, scale }) {
    const { now } = this.state;
    const [x0, x1, y0, y1] = this.facts.bounds;
    const within = (value, least, most) => Math.min(Math.max(value, least), most); // the map cannot get lost
    this.state.set({ x: within(x ?? now.x, x0, x1), y: within(y ?? now.y, y0, y1), z: scale ?? now.z });
  }

  /** The moment that is drawn: that of the picture, so that objects are in step with it. */
  get shownT() {
    return this.pictures.frame?.t ?? this.state.now.t ?? 0;
  }

  #show() {
    this.#update();
    this.draw();
  }

  /** Ask for the tiles of what is in view; whether they are there already. */
  #update() {
    const { view, facts } = this;
    const { t, hold, layers } = this.state.now;
    if (!view.width || !view.height || t === null) return false;
    const fleeting = performance.now() - this.#movedTime < SETTLED_MS;
    this.#coarse = fleeting && this.pictures.tookMs > COARSE_MS;
    const ratio = Math.min(window.devicePixelRatio || 1, MOST_RATIO);
    const finest = Math.floor(SHARPER - Math.log2(this.resolution * view.scale * ratio)) + (this.#coarse ? 1 : 0);
    const zoom = Math.min(Math.max(finest, 0), Math.max(...facts.zooms));
    const tile_m = this.resolution * 2 ** zoom * facts.tile_px;
    const [left, bottom] = toMap(view, 0, view.height);
    const [right, top] = toMap(view, view.width, 0);
    const [x0, x1, y0, y1] = facts.bounds;
    const first = (low, least) => Math.floor(Math.max(low, least) / tile_m);
    const last = (high, most) => Math.ceil(Math.min(high, most) / tile_m) - 1;
    const region = [first(left, x0), last(right, x1), first(bottom, y0), last(top, y1)];
    const shown = facts.layers.filter((layer) => layer.id !== "objects" && (layers[layer.id] ?? 0) > 0);
    let isThere = true;
    if (region[0] <= region[1] && region[2] <= region[3]) {
      isThere = this.pictures.want({
        t,
        hold,
        zoom,
        version: facts.version,
        theme: themeName(),
        layers: shown,
        asked: performance.now(),
        fleeting,
        region: /** @type {[number, number, number, number]} */ (region),
      });
    }
    clearTimeout(this.#settle);
    if (this.#coarse) this.#settle = window.setTimeout(() => this.#update(), SETTLED_MS);
    return isThere;
  }

  #paint() {
    const { context, width, height } = fitted(this.canvas);
    const view = this.view;
    context.fillStyle = colours().unexplored;
    context.fillRect(0, 0, width, height);
    for (const { id } of this.facts.layers) {
      const picture = this.pictures.shown.get(id);
      const opacity = this.state.now.layers[id] ?? 0;
      if (picture && opacity > 0) this.#paintPicture(context, view, picture, opacity);
    }
    context.globalAlpha = 1;
    for (const paint of this.#painters) paint(context, view);
    this.#measure();
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {View} view
   * @param {import("./tiles.js").Picture} picture
   * @param {number} opacity
   */
  #paintPicture(context, view, picture, opacity) {
    const [col, , , row] = picture.region;
    const pixel_m = this.resolution * 2 ** picture.zoom;
    const pixel = pixel_m * view.scale;
    const tile_m = pixel_m * this.facts.tile_px;
    const left = view.width / 2 + (col * tile_m - view.x) * view.scale;
    const top = view.height / 2 - ((row + 1) * tile_m - view.y) * view.scale;
    context.globalAlpha = opacity;
    context.imageSmoothingEnabled = pixel * (window.devicePixelRatio || 1) < CRISP_PX;
    context.drawImage(picture.canvas, left, top, picture.canvas.width * pixel, picture.canvas.height * pixel);
  }

  /** From the slider to the picture: a measure "scrub" for each moment that was asked for and is drawn now. */
  #measure() {
    const { frame } = this.pictures;
    if (!frame || frame === this.#drawn) return;
    this.#drawn = frame;
    const start = this.askedAt.get(frame.t);
    if (start === undefined) return;
    for (const t of this.askedAt.keys()) {
      this.askedAt.delete(t); // with those that were overtaken, but not those that came since
      if (t === frame.t) break;
    }
    if (++this.#n_measured % MOST_MEASURES === 0) performance.clearMeasures("scrub");
    performance.measure("scrub", { start, end: performance.now(), detail: frame.t });
  }
}
