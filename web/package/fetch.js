// GETs of ranges that can be given up, for the engine, which asks once a frame what became of them.

const HEAD = 0, BODY = 1, END = 2, FAILED = 3;

/** Fields that the engine reads. */
const FIELDS = ["content-encoding", "content-length", "content-range", "content-type", "etag", "last-modified",
  "retry-after"];
/** A GET that brings nothing for so long has failed. */
const SILENCE_MS = 20_000;
/** What the engine asks for first of an archive: `GUESS_BYTES` in engine/src/stream/range/load.rs. */
const BEGINNING_BYTES = 64 << 10;
/** Bytes that may wait for the engine; more are read when it has taken some. */
const MOST_WAITING_BYTES = 32 << 20;
/** Beginnings that are asked for early: as many as the engine would at a time. */
const MOST_EARLY = 6;

export class Fetcher {
  #open = new Map();
  /** GETs of beginnings that the engine has not asked for yet, by address. */
  #early = new Map();
  #happenings = [];
  #waitingBytes = 0;
  #drained = [];

  /** GETs that were given up, and all that were started. */
  aborted = 0;
  started = 0;

  /** Asks for the beginning of an archive of a folder while the engine is still loading; the engine then takes what comes. */
  expect(folder, archive) {
    // As in engine/src/stream/escape.rs.
    const name = encodeURIComponent(archive).replace(/[!'()*]/g, (one) => `%${one.charCodeAt(0).toString(16).toUpperCase()}`);
    const url = `${folder}/${name}.bsvtf`;
    if (this.#early.has(url) || this.#early.size >= MOST_EARLY) return;
    const controller = new AbortController();
    const response = ask(url, { Range: `bytes=0-${BEGINNING_BYTES - 1}` }, "no-store", controller);
    response.catch(() => {}); // told when it is asked for
    this.#early.set(url, { controller, response });
  }

  start(id, url, first, end, ifRange, anew) {
    const early = first === 0 && end === BEGINNING_BYTES && ifRange === undefined && !anew ? this.#early.get(url) : undefined;
    this.#early.delete(url);
    const controller = early?.controller ?? new AbortController();
    const get = { controller, timer: 0 };
    this.#open.set(id, get);
    this.started += 1;
    const headers = {};
    if (first !== undefined) headers.Range = `bytes=${first}-${end - 1}`;
    if (ifRange !== undefined) headers["If-Range"] = ifRange;
    // Records are kept by content (store.js); the browser's cache would lock the file and ask for one range after another.
    const cache = anew ? "reload" : "no-store";
    this.#carry(id, get, early?.response ?? ask(url, headers, cache, controller)).catch((error) => {
      if (!this.#open.delete(id)) return; // given up
      const silent = get.controller.signal.reason === "silence";
      const detail = silent ? `it was silent for ${SILENCE_MS / 1000} s` : `it cannot be reached (${error.message})`;
      this.#happenings.push({ id, kind: FAILED, detail });
    }).finally(() => clearTimeout(get.timer));
  }

  abort(id) {
    const get = this.#open.get(id);
    if (!get) return;
    this.#open.delete(id);
    this.aborted += 1;
    get.controller.abort("given up");
    this.#happenings = this.#happenings.filter((happening) => {
      if (happening.id !== id) return true;
      this.#took(happening);
      return false;
    });
  }

  poll() {
    const happening = this.#happenings.shift();
    if (happening) this.#took(happening);
    return happening;
  }

  /** Gives everything up. */
  close() {
    for (const id of [...this.#open.keys()]) this.abort(id);
    for (const { controller } of this.#early.values()) controller.abort("given up");
    this.#early.clear();
  }

  #took(happening) {
    if (happening.kind !== BODY) return;
    this.#waitingBytes -= happening.data.length;
    if (this.#waitingBytes < MOST_WAITING_BYTES) this.#drained.splice(0).forEach((go) => go());
  }

  async #carry(id, get, answer) {
    const alive = () => {
      clearTimeout(get.timer);
      get.timer = setTimeout(() => get.controller.abort("silence"), SILENCE_MS);
    };
    alive();
    const response = await answer;
    if (!this.#open.has(id)) return;
    const lines = FIELDS.filter((name) => response.headers.has(name))
      .map((name) => `${name}: ${response.headers.get(name)}\n`);
    this.#happenings.push({ id, kind: HEAD, status: response.status, fields: lines.join("") });
    const reader = response.body?.getReader();
    while (reader) {
      alive();
      const { done, value } = await reader.read();
      if (!this.#open.has(id)) return;
      if (done) break;
      this.#waitingBytes += value.length;
      this.#happenings.push({ id, kind: BODY, data: value });
      while (this.#waitingBytes >= MOST_WAITING_BYTES && this.#open.has(id)) {
        clearTimeout(get.timer);
        await new Promise((go) => this.#drained.push(go));
      }
    }
    this.#open.delete(id);
    this.#happenings.push({ id, kind: END });
  }
}

/** Fails as an async function does, also for addresses that are none. */
async function ask(url, headers, cache, { signal }) { return fetch(url, { headers, cache, signal }); }
