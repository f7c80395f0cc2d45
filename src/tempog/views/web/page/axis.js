/** The axis of time: linear while robots drive, and narrow where nobody looked for long. */

const PAUSE_WIDTH = 0.02; // share of the driven time's width, as in tempog's timelines
const MOST_PAUSES_WIDTH = 0.3; // all pauses together
const PAUSE_BINS = 3; // an unobserved bin so many times longer than usual is a pause

export class TimeAxis {
  /**
   * @param {number[]} edges  borders of bins, seconds, ascending
   * @param {boolean[]} observed  whether there are scans in each
   */
  constructor(edges, observed) {
    const widths = observed.map((_, k) => edges[k + 1] - edges[k]);
    const usual = median(widths.filter((_, k) => observed[k])) || 1;
    const isPause = widths.map((width, k) => !observed[k] && width > PAUSE_BINS * usual);
    const driven = widths.reduce((sum, width, k) => sum + (isPause[k] ? 0 : width), 0) || 1;
    const n_pauses = isPause.filter(Boolean).length;
    const narrow = driven * Math.min(PAUSE_WIDTH, MOST_PAUSES_WIDTH / Math.max(n_pauses, 1));
    this.knots = edges;
    this.isPause = isPause;
    this.places = [0];
    widths.forEach((width, k) => this.places.push(this.places[k] + (isPause[k] ? narrow : width)));
    const total = this.places[this.places.length - 1] || 1;
    this.places = this.places.map((place) => place / total);
  }

  get start() {
    return this.knots[0];
  }

  get stop() {
    return this.knots[this.knots.length - 1];
  }

  /** Where a moment lies, 0..1. @param {number} t */
  place(t) {
    return interpolate(t, this.knots, this.places);
  }

  /** The moment at a place. @param {number} place 0..1 */
  time(place) {
    return interpolate(place, this.places, this.knots);
  }

  /** The moment after some seconds of playing, which skips pauses. @param {number} t @param {number} seconds */
  later(t, seconds) {
    let next = t + seconds;
    this.isPause.forEach((pause, k) => {
      if (pause && next > this.knots[k] && next < this.knots[k + 1])
        next = this.knots[k + 1] + (next - this.knots[k]);
    });
    return Math.min(next, this.stop);
  }
}

/** @param {number} value @param {number[]} from @param {number[]} to */
function interpolate(value, from, to) {
  const n = from.length - 1;
  if (value <= from[0]) return to[0];
  if (value >= from[n]) return to[n];
  let [low, high] = [0, n];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (from[middle] <= value) low = middle;
    else high = middle;
  }
  const span = from[high] - from[low];
  return span > 0 ? to[low] + ((value - from[low]) / span) * (to[high] - to[low]) : to[low];
}

/** @param {number[]} values */
function median(values) {
  const sorted = [...values].sort((one, other) => one - other);
  return sorted.length ? sorted[sorted.length >> 1] : 0;
}
