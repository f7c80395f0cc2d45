/** What the page knows of the map, asked for anew whenever the map grew or the server was away. */

import { askJson, Refused, Unreachable } from "./api.js";
import { Live } from "./live.js";
import { ordered } from "./panel/layers.js";

const AGAIN_MS = 1000;
const BINS = 400; // of the activity
const LAYERS_OF_OBJECTS = ["people", "people-now"]; // what they show depends on the objects that were found

/**
 * The facts of the map, asked until the server answers.
 * @param {(text: string | null) => void} say
 */
export async function firstFacts(say) {
  for (;;) {
    try {
      const facts = withLayers(await askJson("/api/map"));
      say(null);
      return facts;
    } catch (error) {
      say(error instanceof Refused ? `The map cannot be shown: ${error.message}` : AWAY);
      await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    }
  }
}

const AWAY = "The server does not answer; trying again…";

function withLayers(facts) {
  return { ...facts, layers: ordered(facts.layers) };
}

export class Following {
  /** Where objects and people are now, of a running map. @type {any} */
  present = null;
  /** The versions of the map whose activity and present are shown. @type {string | null} */
  #activityOf = null;
  #renewing = Promise.resolve();

  /**
   * @param {any} facts
   * @param {{time: import("./time.js").TimeBar, map: import("./map.js").MapView, cell: {load: () => void},
   *          objects: import("./objects.js").Objects, say: (text: string | null) => void, onFacts: (facts: any) => void}} page
   */
  constructor(facts, page) {
    this.facts = facts;
    this.page = page;
  }

  /** Ask for all that is not there yet, and listen for news. */
  async begin() {
    this.page.onFacts(this.facts);
    new Live({
      onNews: ({ version, objects }) => {
        if (version !== this.facts.version || objects !== this.facts.objects_version) this.#renewSoon();
      },
      onAway: (away) => {
        this.page.say(away ? AWAY : null);
        if (away) return;
        this.page.map.pictures.retry();
        this.#renewSoon();
      },
    });
    await this.#loadTimes();
    this.#loadObjects();
  }

  #renewSoon() {
    // If the server is away again, it is done once more when it is back.
    this.#renewing = this.#renewing.then(() => this.#renew()).catch((error) => this.#report(error));
  }

  async #renew() {
    const was = this.facts;
    this.facts = withLayers(await askJson("/api/map"));
    this.page.onFacts(this.facts);
    this.page.map.renew(this.facts);
    await this.#loadTimes();
    if (this.facts.version !== was.version) this.page.cell.load();
    if (this.facts.objects_version !== was.objects_version || this.page.objects.status === "away")
      this.#loadObjects();
  }

  /** The activity, and the present of a running map; asked again while the server is busy reading a large map. */
  async #loadTimes() {
    const { version, live } = this.facts;
    while (this.#activityOf !== version && version === this.facts.version) {
      try {
        this.page.time.setActivity(await askJson("/api/activity", { bins: BINS, v: version }));
        this.#activityOf = version;
      } catch (error) {
        if (error instanceof Unreachable) return;
        await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
      }
    }
    this.present = live ? await askJson("/api/now").catch(() => null) : null;
    this.page.map.draw();
  }

  async #loadObjects() {
    await this.page.objects.load(this.facts.objects_version);
    for (const layer of LAYERS_OF_OBJECTS) this.page.map.pictures.forget(layer);
    this.page.map.renew(this.facts);
  }

  /** @param {Error} error */
  #report(error) {
    if (!(error instanceof Unreachable)) this.page.say(`The map cannot be shown anew: ${error.message}`);
  }
}
