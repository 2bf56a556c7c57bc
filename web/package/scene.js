// The files of what is shown, but for archives: those the engine streams.

/** Largest glTF file, and all of its buffers together. */
const MOST_SCENE_BYTES = 512 << 20;
/** Longest glTF file that is read twice, for what begins a moment earlier. */
const MOST_GLANCE_BYTES = 1 << 20;

/** What `src` names, an archive by its name or the bytes of a scene, and where its archives are. */
export async function fetchScene(src, folder, fetcher) {
  const url = new URL(src, document.baseURI);
  const file = decodeURIComponent(url.pathname.slice(url.pathname.lastIndexOf("/") + 1));
  const tiles = new URL(folder ?? ".", url).href.replace(/\/$/, "");
  const archive = /^(.+)\.bsvtf$/i.exec(file)?.[1];
  if (archive) {
    fetcher.expect(tiles, archive);
    return { url, archive, tiles };
  }
  const bytes = await fetchBytes(url, MOST_SCENE_BYTES);
  for (const name of archivesOf(bytes)) fetcher.expect(tiles, name);
  return { url, name: file, bytes, tiles };
}

/** Files that lie beside a scene of so many bytes. */
export async function fetchBuffers(uris, url, already) {
  const buffers = await Promise.all(uris.map((uri) => fetchBytes(new URL(uri, url), MOST_SCENE_BYTES)));
  const bytes = buffers.reduce((sum, buffer) => sum + buffer.length, already);
  if (bytes > MOST_SCENE_BYTES) throw new Error(`the scene has ${bytes} bytes; ${MOST_SCENE_BYTES} are read`);
  return buffers;
}

/** All of a file. */
async function fetchBytes(url, most) {
  let response;
  try {
    response = await fetch(url);
  } catch (error) {
    throw new Error(`${url} cannot be reached (${error.message})`);
  }
  if (!response.ok) throw new Error(`${url}: ${response.status} ${response.statusText}`);
  if (Number(response.headers.get("content-length")) > most) throw new Error(`${url} has more than ${most} bytes`);
  return new Uint8Array(await response.arrayBuffer());
}

/** Names of the archives of a glTF file that is short enough to be looked through before the engine is there. */
function archivesOf(bytes) {
  if (bytes.length > MOST_GLANCE_BYTES) return [];
  try {
    const { materials = [] } = JSON.parse(new TextDecoder().decode(bytes));
    const names = materials.map((material) => material.extensions?.EIGENTILE_materials_btf?.archive);
    return [...new Set(names.filter((name) => typeof name === "string"))];
  } catch {
    return []; // a .glb, or nothing that can be shown: the engine tells
  }
}
