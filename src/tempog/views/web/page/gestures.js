/** Mouse, touch and keys on the map, told as pan, zoom and tap. */

const TAP_PX = 6; // a finger or a hand trembles less
const LONG_PRESS_MS = 550;
const WHEEL_RATE = 0.0016; // per pixel of a wheel's travel
const LINE_PX = 18;
const STEP_PX = 80;
const STEP_ZOOM = 1.5;

/**
 * @typedef {Object} Handlers
 * @property {(dx: number, dy: number) => void} pan      pixels that the map is to move
 * @property {(factor: number, px: number, py: number) => void} zoom
 * @property {(px: number, py: number, deep: boolean) => void} tap   deep: held long, or with Alt or Shift
 * @property {(px: number | null, py: number | null) => void} hover
 * @property {() => void} fit
 */

/**
 * Listen on a canvas.
 * @param {HTMLCanvasElement} canvas
 * @param {Handlers} handlers
 */
export function listen(canvas, handlers) {
  /** @type {Map<number, {x: number, y: number}>} */
  const fingers = new Map();
  let moved = 0;
  let timer = 0;

  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };

  canvas.addEventListener("pointerdown", (event) => {
    if (event.button > 1) return;
    canvas.setPointerCapture(event.pointerId);
    const point = at(event);
    fingers.set(event.pointerId, point);
    moved = fingers.size === 1 ? 0 : Infinity; // two fingers never tap
    clearTimeout(timer);
    if (event.pointerType !== "mouse" && fingers.size === 1) {
      timer = window.setTimeout(() => {
        if (moved > TAP_PX) return;
        moved = Infinity;
        handlers.tap(point.x, point.y, true);
      }, LONG_PRESS_MS);
    }
  });

  canvas.addEventListener("pointermove", (event) => {
    const point = at(event);
    const last = fingers.get(event.pointerId);
    if (!last) {
      if (event.pointerType === "mouse") handlers.hover(point.x, point.y);
      return;
    }
    moved += Math.hypot(point.x - last.x, point.y - last.y);
    if (fingers.size === 1 && moved > TAP_PX) {
      canvas.classList.add("dragging");
      handlers.pan(point.x - last.x, point.y - last.y);
    } else if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const before = Math.hypot(last.x - other.x, last.y - other.y);
      const after = Math.hypot(point.x - other.x, point.y - other.y);
      handlers.pan((point.x - last.x) / 2, (point.y - last.y) / 2);
      if (before > 0) handlers.zoom(after / before, (point.x + other.x) / 2, (point.y + other.y) / 2);
    }
    if (moved > TAP_PX || fingers.size > 1) fingers.set(event.pointerId, point);
  });

  const lift = (event) => {
    const point = fingers.get(event.pointerId);
    fingers.delete(event.pointerId);
    canvas.classList.remove("dragging");
    clearTimeout(timer);
    if (point && event.type === "pointerup" && moved <= TAP_PX && !fingers.size) {
      const { x, y } = at(event);
      handlers.tap(x, y, event.altKey || event.shiftKey);
    }
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("pointerleave", () => handlers.hover(null, null));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());

  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const unit = event.deltaMode === 1 ? LINE_PX : event.deltaMode === 2 ? canvas.clientHeight : 1;
      const { x, y } = at(event);
      const rate = WHEEL_RATE * (event.ctrlKey ? 6 : 1); // a pinch on a touchpad comes as small steps with Ctrl
      handlers.zoom(Math.exp(-Math.max(-240, Math.min(240, event.deltaY * unit)) * rate), x, y);
    },
    { passive: false },
  );

  canvas.addEventListener("dblclick", (event) => {
    const { x, y } = at(event);
    handlers.zoom(event.shiftKey ? 1 / 2 : 2, x, y);
  });

  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey) return;
    const step = STEP_PX * (event.shiftKey ? 4 : 1);
    const [middle_x, middle_y] = [canvas.clientWidth / 2, canvas.clientHeight / 2];
    const actions = {
      ArrowLeft: () => handlers.pan(step, 0),
      ArrowRight: () => handlers.pan(-step, 0),
      ArrowUp: () => handlers.pan(0, step),
      ArrowDown: () => handlers.pan(0, -step),
      "+": () => handlers.zoom(STEP_ZOOM, middle_x, middle_y),
      "=": () => handlers.zoom(STEP_ZOOM, middle_x, middle_y),
      "-": () => handlers.zoom(1 / STEP_ZOOM, middle_x, middle_y),
      0: () => handlers.fit(),
      Enter: () => handlers.tap(middle_x, middle_y, event.altKey || event.shiftKey),
    };
    const act = actions[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
}
