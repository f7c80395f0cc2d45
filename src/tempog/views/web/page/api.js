/** Questions to the server, and whether it answers. */

/** Thrown when the server did not answer at all. */
export class Unreachable extends Error {}

/** Thrown when it answered with an error. */
export class Refused extends Error {}

const BUSY = 503; // or still reading the map

const listeners = new Set();

/**
 * Be told whether the server answers: called with true or false after each request.
 * @param {(reachable: boolean) => void} listener
 */
export function onReachable(listener) {
  listeners.add(listener);
}

/** @param {boolean} reachable */
export function tellReachable(reachable) {
  for (const listener of listeners) listener(reachable);
}

/**
 * A response; Unreachable if there is none.
 * @param {string} path
 * @param {AbortSignal} [signal]
 */
export async function ask(path, signal) {
  let response;
  try {
    response = await fetch(path, { signal, credentials: "same-origin" });
  } catch (error) {
    if (signal?.aborted) throw error;
    tellReachable(false);
    throw new Unreachable(`no answer to ${path}`);
  }
  tellReachable(true);
  return response;
}

/**
 * What an answer holds; Unreachable if the server ended while it came in.
 * @template T
 * @param {() => Promise<T>} take
 * @param {AbortSignal | undefined} signal
 * @param {Response} response
 * @returns {Promise<T>}
 */
async function read(take, signal, response) {
  try {
    return await take();
  } catch (error) {
    signal?.throwIfAborted();
    if (error instanceof SyntaxError) throw new Refused(`the server answered ${response.status}, and no JSON`);
    tellReachable(false);
    throw new Unreachable(`no whole answer to ${response.url}`);
  }
}

/**
 * A picture; null if there is none, Refused if there may be one later.
 * @param {string} path
 * @param {AbortSignal} signal
 */
export async function askPicture(path, signal) {
  const response = await ask(path, signal);
  const content = await read(() => response.blob(), signal, response);
  if (response.status === BUSY) throw new Refused("the server is busy");
  return response.ok && response.status !== 204 ? createImageBitmap(content) : null;
}

/**
 * A JSON answer; Refused, with the server's words, if it is an error.
 * @param {string} path
 * @param {Record<string, any>} [params] those that are null are left out
 * @param {AbortSignal} [signal]
 */
export async function askJson(path, params = {}, signal) {
  const query = new URLSearchParams();
  for (const [key, value] of Object.entries(params))
    if (value !== null && value !== undefined) query.set(key, String(value));
  const response = await ask(query.size ? `${path}?${query}` : path, signal);
  const answer = await read(() => response.json(), signal, response);
  if (!response.ok) throw new Refused(answer.error ?? `the server answered ${response.status}`);
  return answer;
}

/**
 * An answer that takes a while: asked again until it is ready. `onWait` hears of the progress.
 * @param {string} path
 * @param {Record<string, any>} params
 * @param {{signal?: AbortSignal, onWait?: (progress: number | null) => void, everyMs?: number}} how
 */
export async function askUntilReady(path, params, { signal, onWait, everyMs = 700 } = {}) {
  for (;;) {
    const answer = await askJson(path, params, signal);
    if (answer.state === "failed") throw new Refused(answer.error ?? "the search failed");
    if (answer.state !== "working") return answer;
    onWait?.(answer.progress ?? null);
    await new Promise((resolve) => setTimeout(resolve, everyMs));
    signal?.throwIfAborted();
  }
}
