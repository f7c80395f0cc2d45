/** Where map and screen meet: metres with y up, pixels with y down. */

const NEAREST_M = 0.2; // this much of the map fills the screen at most
const FARTHEST = 8; // times the whole map
const FOOT_PX = 52; // at the bottom, where the legend and the scale bar are

/**
 * @typedef {Object} View
 * @property {number} x      middle of the screen, metres
 * @property {number} y
 * @property {number} scale  pixels per metre
 * @property {number} width  pixels
 * @property {number} height
 * @property {number} unit   how much larger than usual signs and text are, on walls
 */

/** @param {View} view @param {number} x @param {number} y @returns {[number, number]} */
export function toScreen(view, x, y) {
  return [view.width / 2 + (x - view.x) * view.scale, view.height / 2 - (y - view.y) * view.scale];
}

/** @param {View} view @param {number} px @param {number} py @returns {[number, number]} */
export function toMap(view, px, py) {
  return [view.x + (px - view.width / 2) / view.scale, view.y - (py - view.height / 2) / view.scale];
}

/**
 * The view that shows a rectangle with a margin.
 * @param {number[]} bounds x_min, x_max, y_min, y_max
 * @param {{width: number, height: number}} screen
 * @param {number} [margin] share of the screen
 */
export function fit(bounds, { width, height }, margin = 0.06) {
  const [x0, x1, y0, y1] = bounds;
  const across = Math.max(x1 - x0, NEAREST_M);
  const up = Math.max(y1 - y0, NEAREST_M);
  const foot = Math.min(FOOT_PX, height / 4);
  const scale = Math.max((1 - margin) * Math.min(width / across, (height - foot) / up), 1e-6);
  return { x: (x0 + x1) / 2, y: (y0 + y1) / 2 - foot / 2 / scale, scale };
}

/**
 * Scale within what is useful for a map.
 * @param {number} scale
 * @param {number[]} bounds
 * @param {{width: number, height: number}} screen
 */
export function limited(scale, bounds, screen) {
  const least = fit(bounds, screen).scale / FARTHEST;
  return Math.min(Math.max(scale, least), Math.max(screen.width, screen.height) / NEAREST_M);
}

/**
 * Zoom by a factor, with the point under a pixel staying there.
 * @param {View} view
 * @param {number} scale wanted
 * @param {number} px
 * @param {number} py
 */
export function zoomedAt(view, scale, px, py) {
  const [x, y] = toMap(view, px, py);
  return { x: x - (px - view.width / 2) / scale, y: y + (py - view.height / 2) / scale, scale };
}

/**
 * A round length for a scale bar that is at most so many pixels long.
 * @param {number} scale
 * @param {number} longest_px
 * @returns {number} metres
 */
export function roundLength(scale, longest_px) {
  const wanted = longest_px / scale;
  const decade = 10 ** Math.floor(Math.log10(wanted));
  return [5, 2, 1].map((step) => step * decade).find((length) => length <= wanted) ?? decade;
}
