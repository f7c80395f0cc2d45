/** Strips of time: what was when, and when nobody looked. Clicking one goes to that moment. */

import { fitted } from "./dom.js";
import { colours } from "./theme.js";

/**
 * @typedef {Object} Band
 * @property {number} from
 * @property {number} to
 * @property {string} fill
 * @property {number} [top]     share of the strip's height, default 0
 * @property {number} [bottom]  default 1
 */

export class Strip {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {{axis: () => import("./axis.js").TimeAxis, moment: () => number, go: (t: number) => void}} time
   */
  constructor(canvas, time) {
    this.canvas = canvas;
    this.time = time;
    /** @type {Band[]} */
    this.bands = [];
    const seek = (event) => {
      const box = canvas.getBoundingClientRect();
      time.go(time.axis().time((event.clientX - box.left) / box.width));
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      seek(event);
    });
    canvas.addEventListener("pointermove", (event) => event.buttons && seek(event));
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  /** @param {Band[]} bands */
  show(bands) {
    this.bands = bands;
    this.draw();
  }

  draw() {
    const { context, width, height } = fitted(this.canvas);
    if (!width) return;
    const axis = this.time.axis();
    context.fillStyle = colours().strip_pale;
    context.fillRect(0, 0, width, height);
    context.fillStyle = hatch(context, colours().gap);
    context.fillRect(0, 0, width, height);
    for (const { from, to, fill, top = 0, bottom = 1 } of this.bands) {
      const left = axis.place(from) * width;
      const wide = Math.max(axis.place(to) * width - left, 1);
      if (top === 0) context.clearRect(left, 0, wide, height);
      context.fillStyle = fill;
      context.fillRect(left, top * height, wide, (bottom - top) * height);
    }
    const x = axis.place(this.time.moment()) * width;
    context.fillStyle = colours().halo;
    context.fillRect(x - 2, 0, 4, height);
    context.fillStyle = colours().ink;
    context.fillRect(x - 1, 0, 2, height);
  }
}

/** @type {Map<string, HTMLCanvasElement>} */
const hatches = new Map();

/**
 * A pattern of slanted lines, for what was not seen.
 * @param {CanvasRenderingContext2D} context
 * @param {string} colour
 * @param {number} [alpha]
 */
export function hatch(context, colour, alpha = 0.75) {
  const key = `${colour} ${alpha}`;
  let tile = hatches.get(key);
  if (!tile) {
    tile = document.createElement("canvas");
    Object.assign(tile, { width: 8, height: 8 });
    const pen = /** @type {CanvasRenderingContext2D} */ (tile.getContext("2d"));
    pen.strokeStyle = colour;
    pen.globalAlpha = alpha;
    pen.lineWidth = 1.6;
    for (const shift of [-8, 0, 8]) {
      pen.beginPath();
      pen.moveTo(shift - 1, 9);
      pen.lineTo(shift + 9, -1);
      pen.stroke();
    }
    hatches.set(key, tile);
  }
  return /** @type {CanvasPattern} */ (context.createPattern(tile, "repeat"));
}
