// <eigentile-viewer src="…">: a scene (.gltf, .glb) or an archive (.bsvtf), streamed and drawn with WebGPU. See README.md.

import { Fetcher } from "./fetch.js";
import { listen } from "./input.js";
import { template } from "./markup.js";
import { fetchBuffers, fetchScene } from "./scene.js";
import { Store } from "./store.js";
import { style } from "./style.js";

/** Pixels of the picture, at most: beyond, it is drawn smaller and scaled. */
const MOST_PIXELS = 4_000_000;
/** How often figures are told, milliseconds. */
const REPORT_MS = 250;
const DEFAULT_CACHE_MIB = 384;

let engine;
/** Loads the engine, once; viewers do that themselves when they need it. */
export function preload() {
  engine ??= (async () => {
    // Both at once. A page may have asked already; what it got can be read once.
    const code = globalThis.eigentileEngine ?? fetch(new URL("engine_bg.wasm", import.meta.url));
    globalThis.eigentileEngine = undefined;
    code.catch(() => {}); // told below
    const module = await import("./engine.js");
    await module.default({ module_or_path: code });
    return module;
  })();
  engine.catch(() => { engine = undefined; });
  return engine;
}

let records;
/** What all viewers of a page keep, between visits too. */
const store = () => records ??= new Store();

/** Why WebGPU cannot be used here; `undefined` if it can. */
export async function missing() {
  const browsers = "Chrome, Edge, Safari 26, and Firefox 141 on Windows have it";
  if (!globalThis.isSecureContext) return "WebGPU needs a secure page: open it with https://, or from localhost.";
  if (!navigator.gpu) return `This browser has no WebGPU. ${browsers}.`;
  if (!await navigator.gpu.requestAdapter({ powerPreference: "high-performance" })) {
    return "This browser has WebGPU, but no graphics adapter for it. Its settings may switch acceleration on.";
  }
  return undefined;
}

export class EigentileViewer extends HTMLElement {
  static observedAttributes = ["src", "tiles", "poster", "label", "exposure", "shape", "cache-mib"];

  #root = this.attachShadow({ mode: "open", delegatesFocus: true });
  #canvas;
  #session;
  #module;
  #fetcher;
  /** Which opening is the newest: older ones that come late are thrown away. */
  #turn = 0;
  #request = 0;
  #reportedAt = 0;
  #report;
  #link = "";
  #pendingLink;
  #worst = 0;
  #was = { shown: false, settled: false, connection: 0 };
  #lightMode = false;
  #seen = true;
  #observers = [];
  #problem;

  constructor() {
    super();
    this.#root.adoptedStyleSheets = [style];
    this.#root.append(template.content.cloneNode(true));
    this.#canvas = this.#find("canvas");
    this.#listen();
  }

  #find(selector) { return this.#root.querySelector(selector); }

  connectedCallback() {
    const sizes = new ResizeObserver(([entry]) => this.#resize(entry));
    sizes.observe(this);
    const views = new IntersectionObserver(([entry]) => { this.#seen = entry.isIntersecting; });
    views.observe(this);
    this.#observers = [sizes, views];
    addEventListener("online", this.#online);
    this.#describe();
    this.#open();
  }

  disconnectedCallback() {
    this.#observers.splice(0).forEach((observer) => observer.disconnect());
    removeEventListener("online", this.#online);
    this.#close();
  }

  attributeChangedCallback(name, before, after) {
    if (!this.isConnected || before === after) return;
    if (name === "src" || name === "tiles") this.#open();
    else if (name === "exposure") this.exposure = Number(after) || 0;
    else if (name === "shape") this.shape = after;
    else if (name === "cache-mib") this.cacheBytes = (Number(after) || DEFAULT_CACHE_MIB) * 2 ** 20;
    else this.#describe();
  }

  // What pages use.

  get src() { return this.getAttribute("src") ?? ""; }
  set src(url) { this.setAttribute("src", url); }

  /** Camera, light, exposure and shape, as a string for addresses. */
  get link() { return this.#session?.link() ?? this.#pendingLink ?? ""; }
  set link(text) {
    if (!this.#session) { this.#pendingLink = text; return; }
    this.#guard(() => this.#session.follow(text));
  }

  /** Stops by which the picture is brightened. */
  get exposure() { return this.#session?.exposure ?? Number(this.getAttribute("exposure") ?? 0); }
  set exposure(stops) { if (this.#session) this.#session.exposure = stops; }

  /** What a lone archive is shown on; `undefined` for scenes. */
  get shape() { return this.#session?.shape; }
  set shape(name) { if (this.#session && name) this.#guard(() => this.#session.set_shape(name)); }

  /** What lies over the picture: a name of `overlays`. */
  get overlay() { return this.#session?.overlay ?? "none"; }
  set overlay(name) { if (this.#session) this.#guard(() => this.#session.set_overlay(name)); }

  /** What can lie over the picture: `{ name, title, legend: [{ label, colour }] }` each. */
  get overlays() {
    const legend = (name) => pairs(this.#module.legend(name)).map(([label, colour]) => ({ label, colour }));
    return this.#session ? pairs(this.#module.overlays()).map(([name, title]) => ({ name, title, legend: legend(name) })) : [];
  }

  /** Bytes of the caches on the GPU. */
  get cacheBytes() { return this.#session?.cache_bytes ?? 0; }
  set cacheBytes(bytes) { if (this.#session) this.#guard(() => this.#session.set_cache_bytes(bytes)); }

  /** Figures of the last frame; `undefined` until there is one. */
  get report() {
    if (!this.#session) return this.#report;
    return {
      ...JSON.parse(this.#session.report()),
      adapter: this.#session.adapter,
      size: [this.#canvas.width, this.#canvas.height],
      gets: { started: this.#fetcher.started, aborted: this.#fetcher.aborted },
      kept_bytes: store().bytes,
    };
  }

  /** What is wrong, if anything is. */
  get problem() { return this.#problem; }

  get settled() { return this.#was.settled; }

  /** Does what a key would do: "reset", "turntable", "next-light"… Returns whether there is such a command. */
  command(name) { return this.#guard(() => this.#session?.command(name)) ?? false; }

  /** Asks again for what could not be had. */
  retry() {
    if (this.#session && this.#request) { this.command("retry"); this.#notice(); } else this.#open();
  }

  /** The picture as it is, as a PNG. */
  async picture() {
    if (!this.#session) throw new Error("there is no picture yet");
    // What a canvas holds can be read in the task in which it was drawn.
    this.#session.present();
    return new Promise((resolve, reject) => this.#canvas.toBlob((blob) => {
      if (blob) resolve(blob); else reject(new Error("the browser gave no picture"));
    }));
  }

  // Opening and closing.

  async #open() {
    this.#close();
    const turn = ++this.#turn;
    const current = () => turn === this.#turn && this.isConnected;
    if (!this.src) return;
    this.#say("Loading.");
    this.#notice();
    this.#fetcher = new Fetcher();
    let session;
    try {
      const [why, module, scene] = await Promise.all([
        missing(),
        navigator.gpu ? preload() : undefined,
        navigator.gpu ? fetchScene(this.src, this.getAttribute("tiles") ?? undefined, this.#fetcher) : undefined,
      ]);
      if (!current()) return;
      if (why) { this.#fetcher.close(); this.#unsupported(why); return; }
      const { url, name, archive, bytes, tiles } = scene;
      this.#module = module;
      const buffers = archive ? [] : await fetchBuffers(module.externals(name, bytes), url, bytes.length);
      if (!current()) return;
      const cache = (Number(this.getAttribute("cache-mib")) || DEFAULT_CACHE_MIB) * 2 ** 20;
      const format = navigator.gpu.getPreferredCanvasFormat();
      this.#fit();
      const setting = new module.Setting(this.#canvas, this.#fetcher, store(), tiles, cache, format);
      session = archive
        ? await module.Session.archive(setting, archive)
        : await module.Session.scene(setting, name, bytes, buffers);
    } catch (error) {
      if (current()) this.#fail(error);
      return;
    }
    if (!current()) { session.free(); return; }
    this.#session = session;
    this.#find("[data-do=next-shape]").hidden = session.shape === undefined;
    this.#fillHelp(pairs(this.#module.help()));
    if (this.hasAttribute("exposure")) this.exposure = Number(this.getAttribute("exposure")) || 0;
    if (this.hasAttribute("shape")) this.shape = this.getAttribute("shape");
    if (this.#pendingLink) this.link = this.#pendingLink;
    this.#pendingLink = undefined;
    this.#fit();
    this.#emit("open");
    this.#request = requestAnimationFrame(this.#tick);
  }

  #close() {
    cancelAnimationFrame(this.#request);
    this.#request = 0;
    this.#fetcher?.close();
    this.#session?.free();
    this.#session = undefined;
    this.#worst = 0;
    this.#was = { shown: false, settled: false, connection: 0 };
    this.#problem = undefined;
    this.toggleAttribute("shown", false);
  }

  // Frames.

  #tick = (time) => {
    this.#request = requestAnimationFrame(this.#tick);
    if (!this.#seen) return;
    const session = this.#session;
    try {
      session.frame(time);
    } catch (error) {
      cancelAnimationFrame(this.#request);
      this.#request = 0;
      this.#fail(error);
      return;
    }
    const now = { shown: session.shown, settled: session.settled, connection: session.connection };
    const was = this.#was;
    this.#was = now;
    if (now.shown && !was.shown) {
      this.toggleAttribute("shown", true);
      this.#say("First picture.");
      this.#tell("firstpicture");
    }
    if (now.connection !== was.connection) this.#connected(now.connection);
    if (now.settled !== was.settled) {
      this.#worst = 0;
      if (now.settled) { this.#say("The picture is complete."); this.#tell("settled"); }
    }
    if (time - this.#reportedAt >= REPORT_MS && !(now.settled && was.settled)) {
      this.#reportedAt = time;
      this.#tell("progress");
    }
    if (time - this.#reportedAt >= REPORT_MS) {
      this.#reportedAt = time;
      this.#changedLink();
    }
  };

  #tell(event) {
    if (!this.#session) return; // whoever listened has closed it
    const report = this.report;
    this.#report = report;
    const { predicted_rms: rms, settled } = report.frame;
    this.#worst = Math.max(this.#worst, rms);
    const share = settled ? 1 : this.#worst > 0 ? Math.min(Math.max(1 - rms / this.#worst, 0), 0.99) : 0;
    const bar = this.#find(".progress");
    const percent = Math.round(share * 100);
    bar.classList.toggle("done", settled);
    bar.setAttribute("aria-valuenow", percent);
    bar.setAttribute("aria-valuetext", `${percent} %, ${megabytes(report.frame.wire_bytes_total)} loaded, error ${rms.toFixed(4)}`);
    bar.firstElementChild.style.width = `${percent}%`;
    this.#emit(event, { ...report, progress: share });
    this.#changedLink();
  }

  #changedLink() {
    if (!this.#session) return;
    const link = this.#session.link();
    if (link === this.#link) return;
    this.#link = link;
    this.#emit("linkchange", link);
  }

  #connected(connection) {
    if (!this.#session) return;
    if (connection === 2) {
      const { message } = JSON.parse(this.#session.report()).connection;
      this.#notice(`Not all can be loaded; what is here stays. ${message ?? ""}`);
      this.#emit("connectionlost");
    } else if (connection === 0) {
      this.#notice();
      this.#emit("connected");
    }
  }

  #online = () => { if (this.#was.connection !== 0) this.retry(); };

  /** Does something that may fail because of what the page has given. */
  #guard(work) {
    try { return work(); } catch (error) { this.#emit("problem", String(error.message ?? error)); return undefined; }
  }

  // Size.

  #resize(entry) {
    const box = entry.devicePixelContentBoxSize?.[0];
    const scale = devicePixelRatio;
    this.#pixels = box
      ? [box.inlineSize, box.blockSize]
      : [entry.contentRect.width * scale, entry.contentRect.height * scale];
    this.#fit();
  }

  #pixels = [0, 0];

  #fit() {
    const [width, height] = this.#pixels;
    if (width < 1 || height < 1) return;
    const shrink = Math.min(1, Math.sqrt(MOST_PIXELS / (width * height)));
    const size = [Math.max(1, Math.round(width * shrink)), Math.max(1, Math.round(height * shrink))];
    if (this.#session) this.#guard(() => this.#session.resize(...size));
    else [this.#canvas.width, this.#canvas.height] = size;
  }

  // Input.

  #listen() {
    listen(this.#canvas, {
      act: (work) => { if (this.#session) this.#guard(() => work(this.#session)); },
      command: (name) => this.#command(name),
      turnsLight: () => this.#lightMode,
    });
    this.#find(".toolbar").addEventListener("click", (event) => {
      const name = event.target.closest("button")?.dataset.do;
      if (name) this.#command(name);
    });
    this.#find(".notice button").addEventListener("click", () => this.retry());
  }

  /** Commands that are not the engine's. */
  #command(name) {
    if (name === "help") this.#find("dialog").showModal();
    else if (name === "escape") this.#canvas.blur();
    else if (name === "light") {
      this.#lightMode = !this.#lightMode;
      this.#find("[data-do=light]").setAttribute("aria-pressed", this.#lightMode);
    } else if (name === "fullscreen") {
      if (document.fullscreenElement) document.exitFullscreen(); else this.requestFullscreen?.().catch(() => {});
    } else if (name === "screenshot") this.save();
    else if (!this.command(name) || ["panel", "split", "radiance"].includes(name)) this.#emit("command", name);
  }

  /** Saves the picture as a file. */
  async save(name = "eigentile.png") {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await this.picture());
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }

  #fillHelp(help) {
    const body = this.#find("tbody");
    if (body.rows.length) return;
    for (const [keys, does] of help) {
      const row = body.insertRow();
      const head = document.createElement("th");
      head.scope = "row";
      head.textContent = keys;
      row.append(head);
      row.insertCell().textContent = does;
    }
  }

  // What is said.

  #describe() {
    const label = this.getAttribute("label") ?? "Material";
    this.#canvas.setAttribute("aria-label", label);
    const poster = this.#find(".poster");
    const url = this.getAttribute("poster");
    poster.hidden = !url;
    if (url) poster.src = url; else poster.removeAttribute("src");
    poster.alt = this.hasAttribute("unsupported") ? label : "";
  }

  #say(text) { this.#find("[role=status]").textContent = text; }

  /** Shows a message with a button, or none. */
  #notice(text, again = true) {
    const notice = this.#find(".notice");
    notice.hidden = !text;
    notice.firstElementChild.textContent = text ?? "";
    notice.querySelector("button").hidden = !again;
    this.#problem = text;
  }

  #unsupported(why) {
    this.toggleAttribute("unsupported", true);
    this.#describe();
    this.#notice(why, false);
    this.#emit("unsupported", why);
  }

  #fail(error) {
    const text = String(error?.message ?? error);
    this.#notice(text);
    this.#emit("error", text);
  }

  #emit(name, detail) { this.dispatchEvent(new CustomEvent(name, { detail })); }
}

/** A list of two things in turns, as pairs. */
const pairs = (list) => Array.from({ length: list.length / 2 }, (_, at) => [list[2 * at], list[2 * at + 1]]);

const megabytes = (bytes) => `${(bytes / 1e6).toFixed(bytes < 1e7 ? 2 : 0)} MB`;

if (!customElements.get("eigentile-viewer")) customElements.define("eigentile-viewer", EigentileViewer);
