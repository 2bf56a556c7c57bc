// Keeps the page for when there is no network: what the server answers is kept, and taken when it does not. Records of archives are kept by
// the viewer itself (eigentile-viewer/store.js), by content.

const CACHE = "eigentile-page-1";
/** Files that are kept; the oldest are given up first. */
const MOST_FILES = 500;

addEventListener("install", () => skipWaiting());
addEventListener("activate", (event) => event.waitUntil(clients.claim()));

addEventListener("fetch", (event) => {
  if (isKept(event.request.url, event.request.method) && !event.request.headers.has("range")) event.respondWith(answer(event));
});

// What a page has loaded before this worker was there.
addEventListener("message", (event) => event.waitUntil(keep(event.data)));

function isKept(address, method) {
  const url = new URL(address);
  return method === "GET" && url.origin === location.origin && !url.pathname.endsWith(".bsvtf");
}

async function answer(event) {
  const { request } = event;
  const cache = await caches.open(CACHE);
  // Pages with different queries are the same page.
  const found = () => cache.match(request, { ignoreSearch: request.mode === "navigate" });
  try {
    const response = await fetch(request);
    if (response.ok) event.waitUntil(cache.put(request, response.clone()));
    return response.status >= 500 ? (await found()) ?? response : response;
  } catch (error) {
    const kept = await found();
    if (kept) return kept;
    throw error;
  }
}

async function keep(addresses) {
  const cache = await caches.open(CACHE);
  const one = async (address) => {
    if (isKept(address, "GET") && !await cache.match(address)) await cache.add(address);
  };
  await Promise.allSettled(addresses.map(one));
  const kept = await cache.keys();
  await Promise.all(kept.slice(0, Math.max(kept.length - MOST_FILES, 0)).map((request) => cache.delete(request)));
}
