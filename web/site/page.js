// The page: the collection, or one of it in the viewer.
//
// Addresses: `#archive/NAME?LINK`, `#scene/NAME?LINK`; or `?src=URL[&tiles=URL]#?LINK` for what is in no collection.

import { fetchCollection } from "./collection.js";
import { connect } from "./panel.js";
import { missing, preload } from "./eigentile-viewer/index.js";

const find = (id) => document.getElementById(id);
const query = new URLSearchParams(location.search);

let collection = { archives: [], scenes: [] };
let shown;
/** Why there is no WebGPU, if there is none. */
let unsupported;

addEventListener("hashchange", route);
find("search").addEventListener("input", list);
start();

async function start() {
  // Beside the catalogue, so that nothing waits for it.
  const engine = navigator.gpu ? preload().catch(() => {}) : Promise.resolve();
  // Not before: it would take requests over, and what early.js has asked for would come twice. Without a worker nothing is kept.
  engine.then(() => navigator.serviceWorker?.register("sw.js")).catch(() => {});
  if (!query.get("src")) {
    try {
      collection = await fetchCollection();
      say("");
    } catch (error) {
      say(`There is no collection here: ${error.message}. Add ?src=URL of a scene or an archive to the address.`);
    }
  }
  list();
  route();
  unsupported = await missing();
  if (unsupported && !shown) say(unsupported);
}

function say(text) { find("message").textContent = text; }

/** What the address names. */
function wanted() {
  const hash = location.hash.slice(1);
  const at = hash.indexOf("?");
  const [path, link] = at < 0 ? [hash, ""] : [hash.slice(0, at), hash.slice(at + 1)];
  const src = query.get("src");
  if (src) {
    const url = new URL(src, document.baseURI);
    const name = decodeURIComponent(url.pathname.split("/").pop()).replace(/\.\w+$/, "");
    return { entry: { key: src, title: name, url: url.href, tiles: query.get("tiles") ?? undefined }, path, link };
  }
  const parts = /^(archive|scene)\/(.+)$/.exec(path);
  if (!parts) return { link };
  const name = decodeURIComponent(parts[2]);
  const entry = collection[`${parts[1]}s`].find((entry) => entry.name === name);
  return { entry: entry && { ...entry, key: path }, path, link, name };
}

function route() {
  const { entry, path, link, name } = wanted();
  const viewing = entry !== undefined;
  find("view").hidden = !viewing;
  find("collection").hidden = viewing;
  find("main").classList.toggle("viewing", viewing);
  if (!viewing) {
    shown?.viewer.remove();
    shown = undefined;
    title("Materials");
    if (name) say(`There is no ${name} in this collection.`);
    else if (unsupported) say(unsupported);
    return;
  }
  if (shown?.key === entry.key) {
    if (link && link !== shown.viewer.link) shown.viewer.link = link;
    return;
  }
  shown?.viewer.remove();
  const viewer = document.createElement("eigentile-viewer");
  shown = { key: entry.key, viewer };
  viewer.setAttribute("label", `${entry.title}, drag to turn`);
  if (entry.thumbnail) viewer.setAttribute("poster", entry.thumbnail);
  if (entry.tiles) viewer.setAttribute("tiles", entry.tiles);
  viewer.setAttribute("src", entry.url);
  if (link) viewer.link = link;
  connect(viewer);
  viewer.addEventListener("linkchange", (event) => {
    history.replaceState(null, "", `#${path ?? ""}?${event.detail}`);
  });
  viewer.addEventListener("settled", keep, { once: true });
  viewer.addEventListener("command", ({ detail }) => { if (detail === "panel") find("panel").hidden = !find("panel").hidden; });
  find("stage").replaceChildren(viewer);
  title(entry.title);
  if (path) find("title").focus({ preventScroll: true });
}

/** Has the service worker keep what the page has loaded so far. */
async function keep() {
  const { active } = await navigator.serviceWorker?.ready ?? {};
  active?.postMessage([location.href.split("#")[0], ...performance.getEntriesByType("resource").map(({ name }) => name)]);
}

function title(text) {
  find("title").textContent = text;
  document.title = text === "Materials" ? "Eigentile" : `${text} – Eigentile`;
}

/** Cards of what the search leaves. */
function list() {
  const sought = find("search").value.trim().toLowerCase();
  for (const kind of ["scenes", "archives"]) {
    const entries = collection[kind].filter(({ name, title }) => `${name} ${title}`.toLowerCase().includes(sought));
    find(kind).replaceChildren(...entries.map(card));
    find(kind).hidden = find(`${kind}-title`).hidden = entries.length === 0;
  }
  find("search").closest("label").hidden = collection.archives.length + collection.scenes.length < 2;
}

function card(entry) {
  const item = document.createElement("li");
  if (entry.error) {
    item.className = "broken";
    item.append(element("strong", entry.name), element("small", entry.error));
    return item;
  }
  const link = document.createElement("a");
  link.href = `#${entry.kind}/${encodeURIComponent(entry.name)}`;
  if (entry.thumbnail) {
    const image = document.createElement("img");
    [image.src, image.alt, image.loading] = [entry.thumbnail, "", "lazy"];
    link.append(image);
  } else {
    const blank = element("span", entry.title.slice(0, 2));
    blank.className = "blank";
    blank.setAttribute("aria-hidden", "true");
    link.append(blank);
  }
  link.append(element("strong", entry.title), element("small", entry.detail));
  item.append(link);
  return item;
}

function element(name, text) {
  const made = document.createElement(name);
  made.textContent = text;
  return made;
}
