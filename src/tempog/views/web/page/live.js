/** The map grows, the server goes and comes back: heard by server-sent events, asked for again when it is away. */

import { askJson, onReachable, tellReachable } from "./api.js";

const AGAIN_MS = [500, 1000, 2000, 4000];
const SILENT_MS = 25_000; // the server says something at least every ten seconds

export class Live {
  /** @type {EventSource | null} */
  #events = null;
  #tries = 0;
  #timer = 0;
  #silence = 0;
  reachable = true;

  /**
   * @param {{onNews: (news: {version: string, t: number, objects: string | null}) => void, onAway: (away: boolean) => void}} handlers
   */
  constructor({ onNews, onAway }) {
    this.onNews = onNews;
    this.onAway = onAway;
    onReachable((reachable) => {
      if (!reachable) this.#lost();
      else if (!this.reachable) this.#found();
    });
    this.#listen();
  }

  #listen() {
    this.#events?.close();
    const events = (this.#events = new EventSource("/api/events"));
    const alive = () => {
      // only who says so every ten seconds can be missed
      clearTimeout(this.#silence);
      this.#silence = window.setTimeout(() => this.#lost(), SILENT_MS);
    };
    events.addEventListener("open", () => tellReachable(true));
    events.addEventListener("alive", alive);
    events.addEventListener("map", (event) => {
      this.onNews(JSON.parse(event.data));
    });
    events.addEventListener("error", () => this.#lost());
  }

  #lost() {
    this.#events?.close();
    this.#events = null;
    clearTimeout(this.#silence);
    if (this.reachable) {
      this.reachable = false;
      this.onAway(true);
    }
    if (this.#timer) return;
    const wait = AGAIN_MS[Math.min(this.#tries++, AGAIN_MS.length - 1)];
    this.#timer = window.setTimeout(() => {
      this.#timer = 0;
      askJson("/api/map").catch(() => {}); // onReachable hears of it
    }, wait);
  }

  #found() {
    this.#tries = 0;
    clearTimeout(this.#timer);
    this.#timer = 0;
    this.reachable = true;
    this.onAway(false);
    this.#listen();
  }
}
