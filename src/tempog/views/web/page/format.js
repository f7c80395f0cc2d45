/** Times, lengths and shares as people read them. */

const DAY = 86400;

/**
 * Seconds from the start: "+7.5 s", "+2:05.0", "+3:04:05".
 * @param {number} t seconds
 * @param {boolean} [fine] with tenths
 */
export function offset(t, fine = true) {
  const sign = t < 0 ? "−" : "+";
  const rounded = fine ? Math.round(Math.abs(t) * 10) / 10 : Math.round(Math.abs(t));
  const seconds = fine ? (rounded % 60).toFixed(1) : String(Math.floor(rounded % 60));
  if (rounded < 60) return `${sign}${seconds} s`;
  const minutes = Math.floor(rounded / 60) % 60;
  const hours = Math.floor(rounded / 3600) % 24;
  const days = Math.floor(rounded / DAY);
  const clock = `${hours || days ? `${hours}:${pad(minutes)}` : minutes}:${seconds.padStart(fine ? 4 : 2, "0")}`;
  return `${sign}${days ? `${days} d ` : ""}${clock}`;
}

/**
 * A length of time: "8.2 s", "12 min", "3 h 5 min", "2 d 4 h".
 * @param {number} seconds
 */
export function duration(seconds) {
  const s = Math.max(0, seconds);
  if (s < 59.95) return `${s < 9.95 ? s.toFixed(1) : Math.round(s)} s`;
  const parts = [
    [DAY, "d"],
    [3600, "h"],
    [60, "min"],
    [1, "s"],
  ];
  let left = Math.round(s);
  const texts = [];
  for (const [unit, name] of /** @type {[number, string][]} */ (parts)) {
    const n = Math.floor(left / unit);
    left -= n * unit;
    if (n) texts.push(`${n} ${name}`);
    if (texts.length && (texts.length === 2 || !n)) break;
  }
  return texts.join(" ");
}

/**
 * The date of a moment, UTC; empty if the log's clock is none.
 * @param {{dated: boolean, startMs: number}} clock
 * @param {number} t seconds from the start
 */
export function date(clock, t) {
  if (!clock.dated) return "";
  const when = new Date(clock.startMs + t * 1000);
  if (Number.isNaN(when.getTime())) return "";
  const day = when.toLocaleDateString("en-GB", { weekday: "short", timeZone: "UTC" });
  return `${day} ${when.toISOString().slice(0, 19).replace("T", " ")} UTC`;
}

/**
 * A moment that somebody typed: seconds, "+12.5", "1:02:03", "2 d 1:02:03" or an ISO date; null if it is none.
 * @param {string} text
 * @param {{dated: boolean, startMs: number}} clock
 */
export function parseMoment(text, clock) {
  const trimmed = text.trim().replace(/^[+]/, "").replace(/\s*s$/, "");
  if (!trimmed) return null;
  const match = /^(?:(\d+)\s*d\s*)?(?:(\d+):)?(?:(\d+):)?(\d+(?:\.\d+)?)$/.exec(trimmed);
  if (match) {
    const [, days, first, second, seconds] = match;
    const [hours, minutes] = second === undefined ? [0, first ?? 0] : [first, second];
    return Number(days ?? 0) * DAY + Number(hours) * 3600 + Number(minutes) * 60 + Number(seconds);
  }
  if (!clock.dated || !/^\d{4}-\d\d-\d\d/.test(trimmed)) return null;
  const iso = trimmed.replace(/\s*UTC$/, "").replace(" ", "T");
  const ms = Date.parse(/[zZ]|[+-]\d\d:?\d\d$/.test(iso.slice(10)) ? iso : `${iso}${iso.length > 10 ? "Z" : ""}`);
  return Number.isNaN(ms) ? null : (ms - clock.startMs) / 1000;
}

/** "(7.0, 2.5) m" @param {number[]} point */
export function place(point) {
  const [x, y] = point.slice(0, 2).map((value) => value.toFixed(1).replace(/^-(0\.0)$/, "$1"));
  return `(${x}, ${y})`;
}

/** "87 %", with a dash for what is unknown. @param {number | null | undefined} share */
export function percent(share) {
  if (share === null || share === undefined || Number.isNaN(share)) return "–";
  const value = share * 100;
  return `${value > 0 && value < 1 ? "<1" : value < 100 && value > 99 ? ">99" : Math.round(value)} %`;
}

/** "12 345" @param {number} n */
export function count(n) {
  return String(Math.round(n)).replace(/\B(?=(\d{3})+$)/g, " ");
}

/** "1 move", "3 moves" @param {number} n @param {string} one @param {string} [many] */
export function counted(n, one, many = `${one}s`) {
  return `${count(n)} ${n === 1 ? one : many}`;
}

/** "A", "B", …, "Z", "AA": names of an object's places. @param {number} k */
export function letter(k) {
  return k < 26 ? String.fromCharCode(65 + k) : letter(Math.floor(k / 26) - 1) + letter(k % 26);
}

/** @param {number} n */
function pad(n) {
  return String(n).padStart(2, "0");
}
