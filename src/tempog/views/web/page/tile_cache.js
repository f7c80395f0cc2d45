/** Tiles that may be needed again, within a bound. */

const CACHE_BYTES = 64 * 2 ** 20;

/** Decoded tiles, the longest unused forgotten first. */
export class TileCache {
  /** @type {Map<string, ImageBitmap>} */
  #tiles = new Map();
  bytes = 0;

  /** @param {number} most_bytes */
  constructor(most_bytes = CACHE_BYTES) {
    this.most_bytes = most_bytes;
  }

  get size() {
    return this.#tiles.size;
  }

  /** @param {string} key */
  get(key) {
    const tile = this.#tiles.get(key);
    if (tile === undefined) return undefined;
    this.#tiles.delete(key);
    this.#tiles.set(key, tile);
    return tile;
  }

  /** @param {string} key @param {ImageBitmap} tile */
  put(key, tile) {
    if (this.#tiles.has(key)) this.#drop(key);
    this.#tiles.set(key, tile);
    this.bytes += weight(tile);
  }

  /** Forget the tiles of a layer. @param {string} layer */
  forget(layer) {
    for (const key of this.#tiles.keys()) if (key.startsWith(`/api/tiles/${layer}/`)) this.#drop(key);
  }

  /** Forget what is too much. Only between frames: a frame holds tiles that it has not drawn yet. */
  trim() {
    for (const key of this.#tiles.keys()) {
      if (this.bytes <= this.most_bytes) return;
      this.#drop(key);
    }
  }

  /** @param {string} key */
  #drop(key) {
    const tile = this.#tiles.get(key);
    if (!tile) return;
    this.#tiles.delete(key);
    this.bytes -= weight(tile);
    tile.close();
  }
}

/** @param {ImageBitmap} tile */
function weight(tile) {
  return tile.width * tile.height * 4;
}
