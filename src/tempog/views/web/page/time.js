/** The time bar: slider, activity, play and speed, and steps from change to change. */

import { TimeAxis } from "./axis.js";
import { byId, el, fitted } from "./dom.js";
import { date, duration, offset, parseMoment } from "./format.js";
import { hatch } from "./strip.js";
import { colours } from "./theme.js";

const SPEEDS = [0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 21600];
const PLAYED_IN_S = 60; // the speed at first plays all of a map in about so long
const STEP_S = 1;
const LONG_STEP_S = 10;
const BUSY_SHARE = 0.35; // a bin that changed this much, measured by the busiest, is a change to step to
const SLIDER_PAD = 11; // half of the slider's thumb, px
const SOON_S = 0.25; // changes nearer than this count as here

export class TimeBar {
  axis = new TimeAxis([0, 1], [true]);
  playing = false;
  /** @type {{edges_t: number[], changes: number[], observed: boolean[]}} */
  #activity = { edges_t: [0, 1], changes: [0], observed: [true] };
  /** Moments of what is selected, to step to; null: the busy moments of the map. @type {() => number[] | null} */
  steps = () => null;
  #frame = 0;
  #last = 0;
  #listeners = new Set();
  #speedIsChosen = false;

  /**
   * @param {import("./state.js").State} state
   * @param {any} facts answer of /api/map
   * @param {import("./map.js").MapView} map
   */
  constructor(state, facts, map) {
    this.state = state;
    this.map = map;
    this.clock = {
      dated: Boolean(facts.dated ?? facts.start_iso),
      startMs: Number(BigInt(facts.start_ns) / 1000000n),
    };
    this.slider = byId("slider");
    this.canvas = byId("activity");
    this.moment = byId("moment");
    this.#setUpSpeed();
    this.setActivity({ edges_t: [0, Math.max(facts.duration_s, 1e-3)], changes: [0], observed: [true] }); // until it is there
    this.slider.addEventListener("input", (event) => this.#slide(event));
    this.slider.addEventListener("keydown", (event) => this.#stepByKey(event));
    byId("play").addEventListener("click", () => this.togglePlay());
    byId("previous").addEventListener("click", () => this.stepTo(-1));
    byId("next").addEventListener("click", () => this.stepTo(1));
    byId("live").addEventListener("click", () => this.goLive());
    this.moment.addEventListener("change", () => this.#typed());
    this.moment.addEventListener("focus", () => this.moment.select());
    this.moment.addEventListener("blur", () => this.show());
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    addEventListener("themechange", () => this.draw());
    state.on(["t"], () => this.state.set({ t: this.#within(this.state.now.t ?? this.axis.stop) })); // addresses may hold any
    state.on(["t", "follow", "a", "b", "tab"], () => this.show());
  }

  /** @param {{edges_t: number[], changes: number[], observed: boolean[]}} activity */
  setActivity(activity) {
    this.#activity = activity;
    this.axis = new TimeAxis(activity.edges_t, activity.observed);
    this.#suggestSpeed();
    this.moment.style.width = `calc(${Math.max(offset(this.axis.stop).length, 9)}ch + 4px)`;
    const { t, follow } = this.state.now;
    if (follow || t === null) this.state.set({ t: this.axis.stop });
    else this.state.set({ t: this.#within(t) });
    for (const listener of this.#listeners) listener();
    this.show();
  }

  /** Be told when the history got longer. @param {() => void} listener */
  onGrown(listener) {
    this.#listeners.add(listener);
  }

  /** Show another moment. @param {number} t @param {{asked?: number}} [how] when it was asked for */
  go(t, { asked } = {}) {
    const within = this.#within(t);
    const moment = Math.round(within * 1000) / 1000;
    if (asked !== undefined) this.map.askedAt.set(moment, asked);
    this.state.set({ t: moment, follow: within === this.axis.stop });
  }

  /** The moment of the history that is nearest. @param {number} t */
  #within(t) {
    return Math.min(Math.max(t, this.axis.start), this.axis.stop);
  }

  goLive() {
    this.stop();
    this.state.set({ t: this.axis.stop, follow: true });
  }

  togglePlay() {
    if (this.playing) return this.stop();
    if ((this.state.now.t ?? 0) >= this.axis.stop - 1e-3) this.go(this.axis.start);
    this.playing = true;
    this.state.set({ follow: false });
    this.#last = performance.now();
    const tick = (now) => {
      if (!this.playing) return;
      const seconds = Math.min(now - this.#last, 250) / 1000;
      this.#last = now;
      this.go(this.axis.later(this.state.now.t ?? 0, seconds * Number(byId("speed").value)));
      if (this.state.now.t >= this.axis.stop - 1e-3) this.stop();
      else this.#frame = requestAnimationFrame(tick);
    };
    this.#frame = requestAnimationFrame(tick);
    this.#showPlay();
  }

  stop() {
    this.playing = false;
    cancelAnimationFrame(this.#frame);
    this.#showPlay();
  }

  /** To the change before or after. @param {-1 | 1} direction */
  stepTo(direction) {
    this.stop();
    const t = this.state.now.t ?? 0;
    const moments = this.steps() ?? this.#busyMoments();
    const next =
      direction > 0
        ? moments.find((moment) => moment > t + SOON_S)
        : moments.findLast((moment) => moment < t - SOON_S);
    this.go(next ?? (direction > 0 ? this.axis.stop : this.axis.start));
  }

  /** @param {1 | -1} direction */
  changeSpeed(direction) {
    const select = byId("speed");
    this.#speedIsChosen = true;
    select.selectedIndex = Math.min(Math.max(select.selectedIndex + direction, 0), select.options.length - 1);
  }

  show() {
    const { t, follow } = this.state.now;
    const moment = t ?? this.axis.stop;
    const place = String(this.axis.place(moment));
    if (this.slider.value !== place) this.slider.value = place;
    const when = date(this.clock, moment);
    this.slider.setAttribute("aria-valuetext", [offset(moment), when].filter(Boolean).join(", "));
    if (document.activeElement !== this.moment) {
      this.moment.value = offset(moment);
      this.moment.setAttribute("aria-invalid", "false");
    }
    byId("moment-date").replaceChildren(
      el("span", { class: "wide", text: when.slice(0, 4) }),
      when.slice(4, 23),
      el("span", { class: "wide", text: when.slice(23) }),
    );
    byId("live").setAttribute("aria-pressed", String(follow));
    this.draw();
  }

  draw() {
    const { context, width, height } = fitted(this.canvas);
    if (!width) return;
    const { edges_t, changes, observed } = this.#activity;
    const inner = width - 2 * SLIDER_PAD;
    const x = (t) => SLIDER_PAD + this.axis.place(t) * inner;
    const most = Math.max(...changes, 1);
    const { strip, strip_pale, gap, accent } = colours();
    const now = this.state.now.t ?? this.axis.stop;
    const paths = [new Path2D(), new Path2D(), new Path2D(), new Path2D()];
    const [past, future, floor, unseen] = paths;
    changes.forEach((n, k) => {
      const [left, right] = [x(edges_t[k]), x(edges_t[k + 1])];
      if (!observed[k]) return unseen.rect(left, 4, right - left, height - 8);
      const tall = Math.sqrt(n / most) * (height - 12);
      floor.rect(left, height - 6, right - left + 0.5, 2);
      if (n)
        (edges_t[k] <= now ? past : future).rect(left, height - 6 - tall, Math.max(right - left - 0.3, 0.7), tall);
    });
    for (const [k, fill] of [accent, strip, strip_pale, hatch(context, gap, 0.5)].entries()) {
      context.fillStyle = fill;
      context.globalAlpha = [0.85, 0.55, 1, 1][k];
      context.fill(paths[k]);
    }
    context.globalAlpha = 1;
    this.#drawMarks(context, x, height);
  }

  /** The two moments that are compared. */
  #drawMarks(context, x, height) {
    const { a, b } = this.state.now;
    context.font = "600 11px system-ui, sans-serif";
    context.textAlign = "center";
    for (const [t, name, colour] of [
      [a, "1", colours().vanished],
      [b, "2", colours().appeared],
    ]) {
      if (t === null) continue;
      context.fillStyle = colour;
      context.fillRect(x(t) - 1, 0, 2, height);
      context.beginPath();
      context.arc(x(t), 8, 8, 0, 7);
      context.fill();
      context.fillStyle = colours().halo;
      context.fillText(name, x(t), 12);
    }
  }

  #slide(event) {
    this.stop();
    this.go(this.axis.time(Number(this.slider.value)), { asked: event.timeStamp });
  }

  /** @param {KeyboardEvent} event */
  #stepByKey(event) {
    const step = event.shiftKey ? LONG_STEP_S : STEP_S;
    const t = this.state.now.t ?? 0;
    const wide = (this.axis.stop - this.axis.start) / 20;
    const targets = {
      ArrowLeft: t - step,
      ArrowDown: t - step,
      ArrowRight: t + step,
      ArrowUp: t + step,
      PageDown: t - wide,
      PageUp: t + wide,
      Home: this.axis.start,
      End: this.axis.stop,
    };
    if (!(event.key in targets)) return;
    event.preventDefault();
    this.stop();
    if (event.key === "End") this.goLive();
    else this.go(targets[event.key], { asked: event.timeStamp });
  }

  #typed() {
    const t = parseMoment(this.moment.value, this.clock);
    this.moment.setAttribute("aria-invalid", String(t === null));
    if (t === null) return;
    this.stop();
    this.go(t);
    this.moment.value = offset(this.state.now.t);
  }

  #busyMoments() {
    const { edges_t, changes } = this.#activity;
    const most = Math.max(...changes, 1);
    const busy = changes.map((n) => n >= BUSY_SHARE * most);
    return edges_t.slice(0, -1).filter((_, k) => busy[k] && !busy[k - 1]);
  }

  #setUpSpeed() {
    const name = (speed) => (speed < 60 ? `${speed}×` : `${duration(speed)}/s`);
    const select = byId("speed");
    select.append(...SPEEDS.map((speed) => el("option", { value: speed, text: name(speed) })));
    select.addEventListener("change", () => (this.#speedIsChosen = true));
  }

  /** The speed that plays all in which robots drove in about a minute, unless another one was chosen. */
  #suggestSpeed() {
    if (this.#speedIsChosen) return;
    const { edges_t, observed } = this.#activity;
    const driven_s = observed.reduce((sum, seen, k) => sum + (seen ? edges_t[k + 1] - edges_t[k] : 0), 0);
    const off = (speed) => Math.abs(Math.log((speed * PLAYED_IN_S) / Math.max(driven_s, 1)));
    byId("speed").value = String(SPEEDS.reduce((one, other) => (off(other) < off(one) ? other : one)));
  }

  #showPlay() {
    byId("play").setAttribute("aria-pressed", String(this.playing));
    byId("play").setAttribute("aria-label", this.playing ? "Pause" : "Play");
    byId("play").title = this.playing ? "Pause (Space)" : "Play (Space)";
    byId("play-icon").setAttribute("href", `/page/icons.svg#${this.playing ? "pause" : "play"}`);
  }
}
