// Records kept in IndexedDB between visits, up to a number of bytes, the least recently used given up first. Failing is forgetting: a
// browser that keeps nothing (private windows) shows the same pictures.

const NAME = "eigentile", VERSION = 1;
/** Keys that are written anew because they were read are told after so long. */
const TOUCH_MS = 24 * 3600_000;

export class Store {
  #database;
  /** Bytes and time of last use, by key; the oldest first. */
  #known = new Map();
  #bytes = 0;
  #budget;
  #found = [];

  constructor(budgetBytes = 256 << 20) {
    this.#budget = budgetBytes;
    this.ready = this.#open().catch(() => { this.#database = undefined; });
  }

  async #open() {
    const request = indexedDB.open(NAME, VERSION);
    request.onupgradeneeded = () => {
      request.result.createObjectStore("records");
      request.result.createObjectStore("uses");
    };
    this.#database = await promised(request);
    // Another page wants to bring a newer version, or the user clears what is kept.
    this.#database.onversionchange = () => { this.#database.close(); this.#database = undefined; };
    const uses = this.#database.transaction("uses").objectStore("uses");
    const [keys, values] = await Promise.all([promised(uses.getAllKeys()), promised(uses.getAll())]);
    const entries = keys.map((key, at) => [key, values[at]]).sort((a, b) => a[1].time - b[1].time);
    for (const [key, use] of entries) {
      this.#known.set(key, use);
      this.#bytes += use.bytes;
    }
  }

  /** What is kept, in bytes. */
  get bytes() { return this.#bytes; }

  holds(key) { return this.#known.has(key); }

  get(number, key) {
    const answer = (bytes) => this.#found.push({ number, bytes });
    this.ready
      .then(() => promised(this.#database.transaction("records").objectStore("records").get(key)))
      .then((bytes) => {
        answer(bytes);
        if (bytes) this.#use(key, bytes.length);
      })
      .catch(() => answer(undefined));
  }

  poll() { return this.#found.shift(); }

  put(key, bytes) {
    if (bytes.length > this.#budget) return;
    this.ready.then(() => {
      this.#forget(key);
      while (this.#bytes + bytes.length > this.#budget) this.remove(this.#known.keys().next().value);
      this.#write((records, uses) => {
        const use = { bytes: bytes.length, time: Date.now() };
        records.put(bytes, key);
        uses.put(use, key);
        this.#known.set(key, use);
        this.#bytes += use.bytes;
      });
    });
  }

  remove(key) {
    this.#forget(key);
    this.#write((records, uses) => { records.delete(key); uses.delete(key); });
  }

  #forget(key) {
    this.#bytes -= this.#known.get(key)?.bytes ?? 0;
    this.#known.delete(key);
  }

  #use(key, bytes) {
    const use = this.#known.get(key);
    if (!use || use.bytes !== bytes) return;
    this.#known.delete(key); // becomes the last
    this.#known.set(key, use);
    if (Date.now() - use.time < TOUCH_MS) return;
    use.time = Date.now();
    this.#write((_, uses) => uses.put(use, key));
  }

  #write(work) {
    try {
      const transaction = this.#database.transaction(["records", "uses"], "readwrite", { durability: "relaxed" });
      transaction.onabort = (event) => event.preventDefault(); // full: the next visit finds less
      work(transaction.objectStore("records"), transaction.objectStore("uses"));
    } catch { /* no database, or closed */ }
  }
}

function promised(request) {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
    request.onblocked = () => reject(new Error("blocked"));
  });
}
