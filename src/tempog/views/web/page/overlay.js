/** What is drawn over the layers: objects in their states, the chosen cell, what changed, people now, the scale bar. */

import { inCells } from "./cells.js";
import { whereabouts } from "./objects.js";
import { hatch } from "./strip.js";
import { colours } from "./theme.js";
import { roundLength, toScreen } from "./view.js";

const LABELS_FROM = 9; // pixels per metre from which all objects are labelled
const FEW = 40; // so few objects are labelled at any zoom
const LABEL_STEPS = [
  [0, 0],
  [0, -1],
  [1, 0],
  [-1, 0],
  [1, -1],
  [-1, -1],
  [0, 2.4],
  [0, -2],
]; // where there is room for a label

/** @param {import("./view.js").View} view */
function font(view) {
  return `600 ${11.5 * view.unit}px system-ui, sans-serif`;
}

/**
 * Objects in the state they had at a moment: filled where they were, hatched where they were last seen, dashed where
 * they are at other times, dotted where that is only supposed.
 * @param {CanvasRenderingContext2D} context
 * @param {import("./view.js").View} view
 * @param {import("./objects.js").Objects} objects
 * @param {{t: number, chosen: number | null, opacity: number, live: Record<string, number | null> | null, labels: boolean}} shown
 */
export function paintObjects(context, view, objects, { t, chosen, opacity, live, labels }) {
  const then = (one) =>
    live && String(one.id) in live ? { known: "seen", place: live[one.id] } : whereabouts(one, t);
  context.save();
  context.globalAlpha = opacity;
  inCells(context, view, objects.resolution, (pixel) => {
    for (const place of objects.places) paintLone(context, pixel, place, t);
    for (const one of objects.all) {
      const where = then(one);
      for (const state of one.states) paintState(context, pixel, one, state, where, one.id === chosen, opacity);
    }
  });
  const all = view.scale > LABELS_FROM || objects.all.length <= FEW;
  const labelled = labels ? objects.all.filter((one) => one.id === chosen || all) : [];
  labelled.sort((one, other) => Number(other.id === chosen) - Number(one.id === chosen));
  const taken = [];
  for (const one of labelled) {
    const isChosen = one.id === chosen;
    if (isChosen) paintLinks(context, view, one);
    const { place } = then(one);
    const state = one.states.find((other) => other.place === place) ?? one.states[0];
    for (const each of isChosen ? one.states : [state]) {
      const at = room(context, view, above(view, each, objects.resolution), taken);
      if (at) label(context, view, at, isChosen ? each.letter : String(one.id), one.colour, each === state);
    }
  }
  context.restore();
}

/**
 * A point near a place where no other label is; null if there is none, or it is out of view.
 * @returns {[number, number] | null}
 */
function room(context, view, [x, y], taken) {
  const [wide, high] = [24 * view.unit, 17 * view.unit];
  if (x < -wide || y < -high || x > view.width + wide || y > view.height + high) return null;
  for (const [right, up] of LABEL_STEPS) {
    const at = /** @type {[number, number]} */ ([x + right * wide, y + up * high]);
    if (taken.some((other) => Math.abs(other[0] - at[0]) < wide && Math.abs(other[1] - at[1]) < high)) continue;
    taken.push(at);
    return at;
  }
  return null;
}

/** Where the label of a place is: above it, so that it hides nothing of it. @returns {[number, number]} */
function above(view, state, resolution) {
  const [x] = toScreen(view, state.centre[0], 0);
  const [, y] = toScreen(view, 0, state.shape.box[3] * resolution);
  return [x, y - 12 * view.unit];
}

function paintState(context, pixel, one, state, where, isChosen, opacity) {
  const here = where.place === state.place && where.known !== "unknown";
  context.lineWidth = (isChosen && here ? 2.2 : 1.4) * pixel;
  context.strokeStyle = one.colour;
  if (here && where.known === "seen") {
    context.fillStyle = one.colour;
    context.setLineDash([]);
  } else if (here) {
    context.fillStyle = hatchOfCells(context, one.colour, pixel);
    context.setLineDash([]);
  } else {
    context.fillStyle = one.colour;
    context.setLineDash(state.hypothesis ? [1.5 * pixel, 3 * pixel] : [5 * pixel, 3.5 * pixel]);
  }
  context.globalAlpha = opacity * (here ? 1 : 0.13);
  context.fill(state.shape.area);
  context.globalAlpha = opacity * (here || isChosen ? 1 : 0.75);
  context.stroke(state.shape.rim);
  context.setLineDash([]);
}

/** Slanted lines as wide as on the screen, for what is drawn in units of cells. */
function hatchOfCells(context, colour, pixel) {
  const pattern = hatch(context, colour, 0.95);
  pattern.setTransform(new DOMMatrix().scale(pixel));
  return pattern;
}

function paintLone(context, pixel, place, t) {
  const period = (place.timeline ?? []).findLast(([start]) => start <= t);
  const occupied = period?.[2] === "occupied";
  context.strokeStyle = context.fillStyle = colours().lone;
  context.lineWidth = 1.2 * pixel;
  context.setLineDash(occupied ? [] : [3 * pixel, 3 * pixel]);
  const alpha = context.globalAlpha;
  context.globalAlpha = alpha * (occupied ? 0.6 : 0.08);
  context.fill(place.shape.area);
  context.globalAlpha = alpha * 0.8;
  context.stroke(place.shape.rim);
  context.globalAlpha = alpha;
  context.setLineDash([]);
}

/** Lines that join the places of the chosen object. */
function paintLinks(context, view, one) {
  context.beginPath();
  one.states.forEach((state, k) => {
    const [x, y] = toScreen(view, state.centre[0], state.centre[1]);
    if (k) context.lineTo(x, y);
    else context.moveTo(x, y);
  });
  haloed(context, one.colour, 1.5 * view.unit);
}

/** Stroke the current path with a rim that keeps it apart from any ground. */
function haloed(context, colour, width) {
  context.lineWidth = width + 2.5;
  context.strokeStyle = colours().halo;
  context.stroke();
  context.lineWidth = width;
  context.strokeStyle = colour;
  context.stroke();
}

/** A short text in a rounded box. */
function label(context, view, [x, y], text, colour, strong = true) {
  const { unit } = view;
  context.font = font(view);
  const width = Math.max(context.measureText(text).width + 8 * unit, 16 * unit);
  context.beginPath();
  context.roundRect(x - width / 2, y - 8 * unit, width, 16 * unit, 8 * unit);
  context.fillStyle = strong ? colour : colours().ground;
  context.fill();
  context.lineWidth = 1.5 * unit;
  context.strokeStyle = strong ? colours().halo : colour;
  context.stroke();
  context.fillStyle = strong ? readableOn(colour) : colours().ink;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, x, y + 0.5);
  context.textBaseline = "alphabetic";
}

/** Black or white, whichever reads better on a colour. @param {string} colour #rrggbb */
export function readableOn(colour) {
  const [r, g, b] = [1, 3, 5].map((at) => (parseInt(colour.slice(at, at + 2), 16) / 255) ** 2.2);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.18 ? "#101217" : "#ffffff";
}

/** The chosen cell, by a point in it. */
export function paintCell(context, view, [x, y], resolution) {
  const [left, top] = toScreen(
    view,
    Math.floor(x / resolution) * resolution,
    (Math.floor(y / resolution) + 1) * resolution,
  );
  const side = Math.max(resolution * view.scale, 2);
  context.beginPath();
  context.rect(left - 1, top - 1, side + 2, side + 2);
  haloed(context, colours().ink, 1.5 * view.unit);
  context.beginPath();
  const [middle_x, middle_y] = [left + side / 2, top + side / 2];
  context.arc(middle_x, middle_y, Math.max(side, 12 * view.unit), 0, 7);
  haloed(context, colours().accent, 2 * view.unit);
}

/** The middle of the map, where Enter asks. */
export function paintCrosshair(context, view) {
  const [x, y] = [Math.round(view.width / 2), Math.round(view.height / 2)];
  context.beginPath();
  for (const [dx, dy] of [
    [1, 0],
    [-1, 0],
    [0, 1],
    [0, -1],
  ]) {
    context.moveTo(x + dx * 4 * view.unit, y + dy * 4 * view.unit);
    context.lineTo(x + dx * 12 * view.unit, y + dy * 12 * view.unit);
  }
  haloed(context, colours().accent, 2 * view.unit);
}

/**
 * What appeared, vanished and moved.
 * @param {CanvasRenderingContext2D} context
 * @param {import("./view.js").View} view
 * @param {any} changed  as panel/compare.js keeps it
 * @param {number} resolution
 * @param {any} chosen  one of the changes
 */
export function paintChanges(context, view, changed, resolution, chosen) {
  inCells(context, view, resolution, (pixel) => {
    for (const kind of ["vanished", "appeared"]) {
      for (const patch of changed[kind]) {
        const gone = kind === "vanished";
        context.fillStyle = gone ? hatchOfCells(context, colours().vanished, pixel) : colours().appeared;
        context.strokeStyle = colours()[kind];
        context.lineWidth = (patch === chosen ? 3 : 1.6) * pixel;
        context.globalAlpha = 0.85;
        context.fill(patch.shape.area);
        context.globalAlpha = 1;
        context.stroke(patch.shape.rim);
      }
    }
  });
  for (const move of changed.moved) {
    const ends = move.path.map(([x, y]) => toScreen(view, x, y));
    if (ends.length === 2) arrow(context, view, ends, move === chosen ? 4 : 2.5);
    else if (move.at) label(context, view, toScreen(view, move.at[0], move.at[1]), "⇄", colours().moved);
  }
  for (const [kind, sign] of [
    ["vanished", "−"],
    ["appeared", "+"],
  ]) {
    for (const patch of changed[kind].slice(0, 60))
      label(context, view, toScreen(view, patch.centre[0], patch.centre[1]), sign, colours()[kind]);
  }
}

function arrow(context, view, [[x0, y0], [x1, y1]], width) {
  const [length, angle] = [Math.hypot(x1 - x0, y1 - y0), Math.atan2(y1 - y0, x1 - x0)];
  const head = Math.min(11 * view.unit, length / 2 + 3);
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  for (const turn of [2.6, -2.6]) {
    context.moveTo(x1, y1);
    context.lineTo(x1 + head * Math.cos(angle + turn), y1 + head * Math.sin(angle + turn));
  }
  haloed(context, colours().moved, width * view.unit);
}

/** People as they stand now. @param {[number, number][]} people */
export function paintPeople(context, view, people) {
  for (const [x, y] of people) {
    const [px, py] = toScreen(view, x, y);
    context.beginPath();
    context.arc(px, py, Math.max(4.5 * view.unit, 0.22 * view.scale), 0, 7);
    context.fillStyle = colours().people;
    context.fill();
    haloed(context, colours().people, view.unit);
  }
}

/** A bar of a round length at the bottom right. */
export function paintScaleBar(context, view) {
  const { unit } = view;
  const length = roundLength(view.scale, Math.min(150 * unit, view.width / 3.5));
  const px = length * view.scale;
  const [x, y] = [view.width - 16 * unit - px, view.height - 16 * unit];
  context.beginPath();
  context.moveTo(x, y - 5 * unit);
  context.lineTo(x, y);
  context.lineTo(x + px, y);
  context.lineTo(x + px, y - 5 * unit);
  haloed(context, colours().ink, 2 * unit);
  const text =
    length >= 1000
      ? `${length / 1000} km`
      : length >= 1
        ? `${length} m`
        : `${Number((length * 100).toPrecision(1))} cm`;
  context.font = font(view);
  context.textAlign = "center";
  context.lineWidth = 3.5 * unit;
  context.strokeStyle = colours().halo;
  context.strokeText(text, x + px / 2, y - 7 * unit);
  context.fillStyle = colours().ink;
  context.fillText(text, x + px / 2, y - 7 * unit);
}
