// How long a first picture takes over a slow network: `node measure.mjs PROGRAM DIST FOLDER [MBIT/S [MS]]`.
//
// Every entry of FOLDER's catalogue is opened by an empty browser, in a small and in a large picture. Told are the times at which the module
// is there, at which the viewer opens, and at which the picture is drawn: what lies between the last two is mostly the compiler of
// SwiftShader, which stands in for a graphics card here.

import { Browser } from "./chromium.mjs";
import { Server } from "./servers.mjs";

const [program, dist, folder, megabits = "8", latency = "50"] = process.argv.slice(2);
if (!folder) throw new Error("usage: node measure.mjs PROGRAM DIST FOLDER [MBIT/S [MS]]");

const server = await Server.start(program, folder, dist);
const browser = await Browser.start();
const { archives, scenes } = await (await fetch(`${server.address}/v1/`)).json();
const entries = [...archives.map(({ name }) => `archive/${name}`), ...scenes.map(({ name }) => `scene/${name}`)];
console.log(`${megabits} Mbit/s, ${latency} ms; seconds since the address was given, and bytes until the first picture`);
for (const entry of entries) {
  for (const [width, height] of [[96, 72], [480, 360]]) {
    const context = await browser.context();
    const page = await context.newPage();
    await page.addInitScript(([width, height]) => {
      window.told = new Promise((resolve) => {
        const meet = new MutationObserver(() => {
          const viewer = document.querySelector("eigentile-viewer");
          if (!viewer) return;
          meet.disconnect();
          viewer.style.cssText = `inset: 0 auto auto 0; min-height: 0; width: ${width}px; height: ${height}px`;
          let opened;
          viewer.addEventListener("open", () => { opened = performance.now() / 1000; });
          for (const name of ["firstpicture", "error"]) {
            viewer.addEventListener(name, () => resolve({
              name,
              opened,
              module: performance.getEntriesByType("resource").find(({ name }) => name.endsWith(".wasm"))?.responseEnd / 1000,
              seconds: performance.now() / 1000,
              bytes: performance.getEntriesByType("resource").reduce((sum, { transferSize }) => sum + transferSize, 0),
              tiles: viewer.report?.frame.wire_bytes_total,
            }));
          }
        });
        meet.observe(document, { childList: true, subtree: true });
      });
    }, [width, height]);
    const session = await context.newCDPSession(page);
    await session.send("Network.enable");
    const rate = Number(megabits) * 1e6 / 8;
    await session.send("Network.emulateNetworkConditions",
      { offline: false, latency: Number(latency), downloadThroughput: rate, uploadThroughput: rate });
    await page.goto(`${server.address}/#${entry}`, { waitUntil: "commit" });
    const { name, module, opened, seconds, bytes, tiles } = await page.evaluate(() => window.told);
    const times = `module ${module?.toFixed(2)} s, open ${opened?.toFixed(2)} s, ${name} ${seconds.toFixed(2)} s`;
    console.log(`${entry}, ${width}x${height}: ${times}; ${bytes} bytes, ${tiles} of them of archives`);
    await context.close();
  }
}
await browser.stop();
await server.stop();
