/** Shapes of sets of cells, in units of cells. */

/**
 * The cells as squares, and the line around them.
 * @param {[number, number][]} cells  row and column
 */
export function shapeOf(cells) {
  const here = new Set(cells.map(([row, col]) => `${row} ${col}`));
  const area = new Path2D();
  const rim = new Path2D();
  const [rows, cols] = [cells.map(([row]) => row), cells.map(([, col]) => col)];
  for (const [row, col] of cells) {
    area.rect(col, row, 1, 1);
    const edges = [
      [row - 1, col, col, row, col + 1, row],
      [row + 1, col, col, row + 1, col + 1, row + 1],
      [row, col - 1, col, row, col, row + 1],
      [row, col + 1, col + 1, row, col + 1, row + 1],
    ];
    for (const [next_row, next_col, x0, y0, x1, y1] of edges) {
      if (here.has(`${next_row} ${next_col}`)) continue;
      rim.moveTo(x0, y0);
      rim.lineTo(x1, y1);
    }
  }
  const box = [
    extreme(cols, Math.min),
    extreme(cols, Math.max) + 1,
    extreme(rows, Math.min),
    extreme(rows, Math.max) + 1,
  ];
  return { area, rim, here, box };
}

/**
 * Metres of a box of cells: x_min, x_max, y_min, y_max.
 * @param {number[]} box
 * @param {number} resolution
 */
export function boundsOf(box, resolution) {
  return box.map((side) => side * resolution);
}

/** The smallest rectangle around several. @param {number[][]} boxes */
export function around(boxes) {
  return [
    Math.min(...boxes.map((box) => box[0])),
    Math.max(...boxes.map((box) => box[1])),
    Math.min(...boxes.map((box) => box[2])),
    Math.max(...boxes.map((box) => box[3])),
  ];
}

/** @param {number[]} values @param {(one: number, other: number) => number} pick */
function extreme(values, pick) {
  return values.reduce((one, other) => pick(one, other), values[0] ?? 0);
}

/**
 * Draw in units of cells; widths of lines are `pixel` times what they are on an ordinary screen.
 * @param {CanvasRenderingContext2D} context
 * @param {import("./view.js").View} view
 * @param {number} resolution
 * @param {(pixel: number) => void} draw
 */
export function inCells(context, view, resolution, draw) {
  const scale = resolution * view.scale;
  context.save();
  context.translate(view.width / 2 - view.x * view.scale, view.height / 2 + view.y * view.scale);
  context.scale(scale, -scale);
  draw(view.unit / scale);
  context.restore();
}
