// What there is to show: the catalogue of a tile server, or a file of the same form on any web server.

/** Where the catalogue is looked for, in this order; `?collection=URL` says another place. */
const PLACES = ["v1/", "collection.json"];

/**
 * The collection: `{ scenes, archives }`, each `{ name, title, url, tiles, thumbnail, detail, error }` with absolute addresses.
 * A catalogue is `{"archives": [{"name": "cloth"}, …], "scenes": [{"name": "room", "url": "room.gltf"}, …]}`; addresses in it are
 * relative to it. docs/http.md describes all members.
 */
export async function fetchCollection() {
  const own = new URLSearchParams(location.search).get("collection");
  const troubles = [];
  for (const place of own ? [own] : PLACES) {
    const url = new URL(place, document.baseURI);
    try {
      const response = await fetch(url, { headers: { Accept: "application/json" } });
      if (response.ok) return read(await response.json(), url);
      troubles.push(`${url}: ${response.status} ${response.statusText}`);
    } catch (error) {
      troubles.push(`${url}: ${error.message}`);
    }
  }
  throw new Error(troubles.join("; "));
}

function read(catalogue, base) {
  const address = (url) => url === undefined ? undefined : new URL(url, base).href;
  const tiles = new URL(catalogue.tiles ?? ".", base).href;
  const archives = (catalogue.archives ?? []).map((entry) => ({
    kind: "archive",
    name: String(entry.name),
    title: String(entry.title || entry.name),
    url: address(entry.urls?.archive ?? `${encodeURIComponent(entry.name)}.bsvtf`),
    thumbnail: address(entry.thumbnail),
    detail: [entry.width && `${entry.width} × ${entry.height}`, entry.components && `${entry.components} components`,
      entry.bytes && size(entry.bytes)].filter(Boolean).join(", "),
    error: entry.error,
  }));
  const scenes = (catalogue.scenes ?? []).map((entry) => ({
    kind: "scene",
    name: String(entry.name),
    title: String(entry.title || entry.name),
    url: address(entry.url),
    tiles: entry.tiles === undefined ? tiles : address(entry.tiles),
    thumbnail: address(entry.thumbnail),
    detail: entry.bytes ? size(entry.bytes) : "",
  }));
  return { archives, scenes };
}

export function size(bytes) {
  if (bytes < 1e6) return `${(bytes / 1e3).toFixed(1)} kB`;
  return bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(2)} GB`;
}
