// The viewer in Chromium, on the real program: `cargo xtask test` runs it as `node browser.mjs PROGRAM DIST`.
//
// WebGPU is SwiftShader's, which is slow: pictures are small. A name as a third argument runs only the tests that have it in their name.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { Browser } from "./chromium.mjs";
import { makeCollection } from "./collection.mjs";
import { Server, StaticHost } from "./servers.mjs";

const [program, dist, only = ""] = process.argv.slice(2);
if (!program || !dist) throw new Error("usage: node browser.mjs PROGRAM DIST [NAME]");

/** Pixels of pictures that are compared. */
const SIZE = [96, 72];
/** Longest wait for anything. */
const PATIENCE = 90_000;

const scratch = mkdtempSync(join(tmpdir(), "eigentile-browser-"));
const collection = makeCollection(resolve(program), resolve(dist, "../../target/web-tests"));
const server = await Server.start(program, collection, dist);
const browser = await Browser.start();

/** An open page, and a viewer in it of the size of pictures that are compared. */
async function view(page, hash, { size = SIZE, query = "" } = {}) {
  await page.goto(`${server.address}/${query}#${hash}`);
  await page.waitForSelector("eigentile-viewer", { state: "attached" });
  await page.evaluate(([width, height]) => {
    const viewer = document.querySelector("eigentile-viewer");
    viewer.style.cssText = `inset: 0 auto auto 0; min-height: 0; width: ${width}px; height: ${height}px`;
  }, size);
}

/** Waits until the picture of this size is complete. */
const settled = (page, size = SIZE) => page.waitForFunction(([width, height]) => {
  const viewer = document.querySelector("eigentile-viewer");
  const report = viewer.settled && viewer.report;
  return report && report.size[0] === width && report.size[1] === height && report.frame.settled;
}, size, { timeout: PATIENCE });

const report = (page) => page.evaluate(() => document.querySelector("eigentile-viewer").report);
const link = (page) => page.evaluate(() => document.querySelector("eigentile-viewer").link);
const picture = (page) => page.evaluate(async () => {
  const blob = await document.querySelector("eigentile-viewer").picture();
  return [...new Uint8Array(await blob.arrayBuffer())];
});

/** How two PNGs differ, in 255ths: the mean over all channels, and the largest of all but one in a hundred. */
const difference = (page, a, b) => page.evaluate(async (both) => {
  const pixels = async (png) => {
    const image = await createImageBitmap(new Blob([new Uint8Array(png)]));
    const canvas = new OffscreenCanvas(image.width, image.height);
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    return { size: [image.width, image.height], data: context.getImageData(0, 0, image.width, image.height).data };
  };
  const [a, b] = await Promise.all(both.map(pixels));
  if (`${a.size}` !== `${b.size}`) throw new Error(`pictures of ${a.size} and ${b.size} pixels`);
  const differences = a.data.map((value, at) => Math.abs(value - b.data[at])).filter((_, at) => at % 4 < 3).sort((a, b) => a - b);
  const sum = differences.reduce((sum, value) => sum + value, 0);
  return { mean: sum / differences.length, most: differences[Math.floor(differences.length * 0.99)] };
}, [a, b]);

/** What the program itself draws. */
function native(scene) {
  const output = join(scratch, scene);
  const run = spawnSync(program, ["render", join(collection, `${scene}.gltf`), "--tiles", collection, "--size", SIZE.join("x"),
    "--output", output], { encoding: "utf8" });
  assert.equal(run.status, 0, run.stderr);
  return [...readFileSync(join(output, "settled.png"))];
}

const drag = async (page, [x0, y0], [x1, y1], key) => {
  const box = await page.locator("eigentile-viewer").boundingBox();
  if (key) await page.keyboard.down(key);
  await page.mouse.move(box.x + x0, box.y + y0);
  await page.mouse.down();
  await page.mouse.move(box.x + x1, box.y + y1, { steps: 4 });
  await page.mouse.up();
  if (key) await page.keyboard.up(key);
};

/** Acts, and waits until something else is read than before. */
const changes = async (page, read, act, before) => {
  before ??= await read(page);
  await act();
  const deadline = Date.now() + PATIENCE;
  for (;;) {
    const now = await read(page);
    if (now !== before) return now;
    assert(Date.now() < deadline, `it stays ${before}`);
    await page.evaluate(() => new Promise(requestAnimationFrame));
  }
};

/** The largest difference of any two numbers in links of the same form: they have six digits, of numbers with more. */
function linkDistance(a, b) {
  const number = /-?\d+(?:\.\d+)?(?:e-?\d+)?/g;
  assert.equal(a.replace(number, "#"), b.replace(number, "#"));
  const [these, those] = [a, b].map((link) => link.match(number).map(Number));
  return Math.max(...these.map((value, at) => Math.abs(value - those[at])));
}

const tests = {
  async "the page lists the collection, and every control has a name"() {
    const page = await browser.page();
    await page.goto(`${server.address}/`);
    await page.waitForSelector("#archives a");
    const cards = await page.$$eval(".cards a", (links) => links.map((link) => link.hash));
    assert.deepEqual(cards, ["#scene/pair", "#scene/square", "#archive/cloth", "#archive/gravel"]);
    await page.waitForFunction(() => [...document.images].filter(({ complete, naturalWidth }) => complete && naturalWidth).length >= 2);
    await page.fill("#search", "grav");
    assert.equal(await page.locator(".cards a:visible").count(), 1);
    await page.fill("#search", "");
    const nameless = await page.$$eval("input, select, button, a, [role=img]", (controls) => controls
      .filter((control) => !(control.labels?.length || control.textContent.trim() || control.ariaLabel))
      .map((control) => control.outerHTML));
    assert.deepEqual(nameless, []);
    await browser.done(page);
  },

  async "an archive opens, shows a first picture, settles, and is in the address"() {
    const page = await browser.page();
    await page.goto(`${server.address}/`);
    await page.evaluate(() => {
      window.told = [];
      for (const name of ["open", "firstpicture", "settled", "error"]) document.addEventListener(name, () => window.told.push(name), true);
    });
    await page.setViewportSize({ width: 480, height: 200 });
    const asked = [];
    page.on("request", (request) => asked.push(request.headers().range));
    await page.click("text=cloth");
    await page.waitForFunction(() => window.told.includes("settled"), null, { timeout: PATIENCE });
    assert.deepEqual(await page.evaluate(() => window.told), ["open", "firstpicture", "settled"]);
    const { frame, shown, materials } = await report(page);
    assert(shown && frame.pages_resident > 0 && frame.wire_bytes_total > 1000, JSON.stringify(frame));
    assert.equal(materials[0].name, "cloth");
    assert.match(page.url(), /#archive\/cloth\?cam=/);
    const bar = await page.getByRole("progressbar").getAttribute("aria-valuenow");
    assert.equal(bar, "100");
    assert.match(await page.locator("eigentile-viewer [role=status]").textContent(), /complete/);
    await page.selectOption("#shape", "sphere");
    await page.waitForFunction(() => /shape=sphere/.test(location.hash), null, { timeout: PATIENCE });
    assert(await page.locator("#figures dd").count() > 8);
    assert.equal(asked.filter((range) => range === "bytes=0-65535").length, 1, "the beginning is asked for early, and once");
    await page.locator("eigentile-viewer").getByRole("application").focus();
    await page.keyboard.press("p");
    await page.locator("#panel").waitFor({ state: "hidden" });
    await browser.done(page);
  },

  async "pictures equal those of the program"() {
    const page = await browser.page();
    const pictures = [];
    for (const scene of ["square", "pair"]) {
      await view(page, `scene/${scene}`);
      await settled(page);
      const [shown, wanted] = [await picture(page), native(scene)];
      const { mean, most } = await difference(page, shown, wanted);
      assert(mean < 0.5 && most <= 4, `${scene}: mean ${mean}, most ${most} of 255`);
      pictures.push(shown);
    }
    const { mean } = await difference(page, ...pictures);
    assert(mean > 2, `a comparison that cannot fail: ${mean}`);
    await browser.done(page);
  },

  async "camera, light, exposure and overlay change the picture, and a link brings them back"() {
    const page = await browser.page();
    await view(page, "scene/square");
    await settled(page);
    const before = await picture(page);
    const part = (name) => async (page) => new URLSearchParams(await link(page)).get(name);
    await changes(page, part("cam"), () => drag(page, [40, 30], [70, 45]));
    await changes(page, part("light"), () => drag(page, [40, 30], [60, 20], "Control"));
    await changes(page, part("cam"), () => page.keyboard.press("ArrowLeft", { delay: 120 }));
    await page.locator("#exposure").fill("1");
    assert.equal(await part("ev")(page), "1");
    await settled(page);
    const after = await picture(page);
    assert((await difference(page, before, after)).mean > 2);
    const wanted = await link(page);
    const again = await browser.page();
    await view(again, `scene/square?${wanted}`);
    await settled(again);
    assert(linkDistance(await link(again), wanted) < 1e-4, `${await link(again)} for ${wanted}`);
    const { mean } = await difference(page, after, await picture(again));
    assert(mean < 0.5, `${mean}`);
    await again.selectOption("#overlay", "mip");
    await again.waitForFunction(() => document.querySelectorAll("#legend li").length > 2);
    await changes(again, async () => (await difference(page, after, await picture(again))).mean > 2, () => {}, false);
    await browser.done(page, again);
  },

  async "what the camera leaves behind is given up"() {
    const page = await browser.page({ serviceWorkers: "block", allow: /Service Worker registration blocked/ });
    const records = await browser.hold(page);
    await view(page, "scene/pair?cam=-2,0.25,1,-2,0.25,0,40");
    const inFlight = (page) => page.waitForFunction(() => document.querySelector("eigentile-viewer").report?.gets.started > 3, null,
      { timeout: PATIENCE });
    await inFlight(page);
    // From one square, so near that nothing else is seen, to the other.
    await page.evaluate(() => { document.querySelector("eigentile-viewer").link = "cam=2,0.25,1,2,0.25,0,40"; });
    await page.waitForFunction(() => document.querySelector("eigentile-viewer").report.gets.aborted > 0, null, { timeout: PATIENCE });
    assert((await report(page)).counters.requests_cancelled > 0);
    assert(records.failed.length > 0, "and the browser ends the requests");
    records.release();
    await settled(page);
    await browser.done(page);
  },

  async "a server that is away is told, and one that is back is asked again"() {
    const page = await browser.page({ serviceWorkers: "block", quiet: false });
    const records = await browser.hold(page);
    await view(page, "archive/gravel");
    await page.waitForFunction(() => document.querySelector("eigentile-viewer").report?.frame.in_flight > 0, null,
      { timeout: PATIENCE });
    await server.stop();
    records.release();
    const notice = page.locator("eigentile-viewer [role=alert]");
    await notice.waitFor({ timeout: PATIENCE });
    assert(!await page.evaluate(() => document.querySelector("eigentile-viewer").settled));
    await notice.getByRole("button").waitFor();
    await server.restart();
    // It is found again by itself, too: after a while, or before the button is pressed.
    const gone = notice.waitFor({ state: "hidden", timeout: PATIENCE });
    await Promise.any([notice.getByRole("button").click(), gone]);
    await settled(page);
    await gone;
    await page.close();
  },

  async "what was seen is there without a network"() {
    const context = await browser.context();
    const page = await context.newPage();
    await view(page, "archive/cloth");
    await settled(page);
    const before = await picture(page);
    const wanted = await link(page);
    // The worker that keeps the page has taken what was loaded before it.
    await page.waitForFunction(async () => {
      const cache = await caches.open((await caches.keys())[0]);
      const kept = (await cache.keys()).map(({ url }) => new URL(url).pathname);
      return ["/", "/page.js", "/v1/", "/eigentile-viewer/engine_bg.wasm"].every((path) => kept.includes(path));
    }, null, { timeout: PATIENCE });
    await page.close();
    await server.stop();
    try {
      const offline = await context.newPage();
      await view(offline, `archive/cloth?${wanted}`);
      await settled(offline);
      const { source } = await report(offline);
      assert(source.offline === 1 && source.from_disk > 0, JSON.stringify(source));
      const { mean } = await difference(offline, before, await picture(offline));
      assert(mean < 0.5, `${mean}`);
    } finally {
      await server.restart();
    }
    await context.close();
  },

  async "a narrow screen, touched"() {
    const page = await browser.page({ viewport: { width: 320, height: 568 }, hasTouch: true, isMobile: true });
    await page.goto(`${server.address}/`);
    await page.waitForSelector("#archives a");
    const wide = () => page.evaluate(() => document.documentElement.scrollWidth > innerWidth);
    assert(!await wide(), "the collection is wider than the screen");
    await page.goto(`${server.address}/#archive/cloth`);
    await page.waitForSelector("eigentile-viewer");
    assert(!await wide(), "the viewer is wider than the screen");
    const [stage, panel] = await Promise.all(["#stage", "#panel"].map((id) => page.locator(id).boundingBox()));
    assert(panel.y >= stage.y + stage.height && panel.width <= 320, "the panel is below");
    const targets = await page.$$eval("#panel button, #panel select", (all) => all.filter((one) => one.checkVisibility())
      .map((one) => one.getBoundingClientRect().height));
    assert(targets.length > 4 && targets.every((height) => height >= 36), `${targets}`);
    await view(page, "archive/cloth");
    await settled(page);
    const touch = await page.context().newCDPSession(page);
    const at = (x, y) => ({ touchPoints: [{ x, y, id: 1 }] });
    await page.evaluate(() => scrollTo(0, 0));
    const box = await page.locator("eigentile-viewer").boundingBox();
    await changes(page, link, async () => {
      await touch.send("Input.dispatchTouchEvent", { type: "touchStart", ...at(box.x + 30, box.y + 30) });
      await touch.send("Input.dispatchTouchEvent", { type: "touchMove", ...at(box.x + 50, box.y + 36) });
      await touch.send("Input.dispatchTouchEvent", { type: "touchMove", ...at(box.x + 70, box.y + 40) });
      await touch.send("Input.dispatchTouchEvent", { type: "touchEnd", touchPoints: [] });
    });
    await browser.done(page);
  },

  async "without WebGPU there is a message, and the thumbnail"() {
    const page = await browser.page();
    await page.addInitScript(() => Object.defineProperty(Navigator.prototype, "gpu", { get: () => undefined }));
    await page.goto(`${server.address}/#scene/square`);
    const notice = page.locator("eigentile-viewer [role=alert]");
    await notice.waitFor();
    assert.match(await notice.textContent(), /no WebGPU/);
    const poster = page.locator("eigentile-viewer img");
    assert(await poster.isVisible() && await poster.evaluate(({ naturalWidth }) => naturalWidth > 0));
    const loaded = await page.evaluate(() => performance.getEntriesByType("resource").map(({ name }) => name));
    assert(!loaded.some((name) => name.endsWith(".wasm")), "nobody needs the module");
    await page.goto(`${server.address}/#`);
    assert.match(await page.locator("#message").textContent(), /no WebGPU/);
    await browser.done(page);
  },

  async "a static host and a page of somebody else"() {
    const host = await StaticHost.start({ "/": dist, "/data/": collection }, {
      "/collection.json": JSON.stringify({ archives: [{ name: "cloth", urls: { archive: "data/cloth.bsvtf" } }] }),
      "/own.html": `<!doctype html><title>Own</title><link rel="icon" href="icon.svg"><script type="module" src="eigentile-viewer/index.js"></script>
        <eigentile-viewer src="data/pair.gltf" label="Two" style="min-height: 0; width: 96px; height: 72px"></eigentile-viewer>`,
    });
    const page = await browser.page({ allow: /v1\// });
    await page.goto(`${host.address}/own.html`);
    await settled(page);
    assert.equal((await report(page)).materials.length, 2);
    await page.goto(`${host.address}/`);
    await page.waitForSelector("#archives a");
    await page.goto(`${host.address}/?src=data/cloth.bsvtf#?ev=1`);
    await page.waitForFunction(() => document.querySelector("eigentile-viewer")?.report?.shown, null, { timeout: PATIENCE });
    assert.match(await link(page), /ev=1/);
    assert(host.ranges > 0);
    await browser.done(page);
    await host.stop();
  },

  async "what cannot be shown is said"() {
    const page = await browser.page({ quiet: false });
    await page.goto(`${server.address}/?src=v1/files/none.gltf`);
    const notice = page.locator("eigentile-viewer [role=alert]");
    await notice.waitFor();
    assert.match(await notice.textContent(), /none\.gltf: 404/);
    await page.goto(`${server.address}/?src=v1/none.bsvtf`);
    await notice.waitFor({ timeout: PATIENCE });
    assert.match(await notice.textContent(), /none/);
    await page.goto(`${server.address}/#scene/square?cam=1,2`);
    await page.waitForFunction(() => /link/.test(document.getElementById("said").textContent), null, { timeout: PATIENCE });
    await page.close();
  },
};

let failed = 0;
for (const [name, test] of Object.entries(tests).filter(([name]) => name.includes(only))) {
  const start = Date.now();
  try {
    await test();
    console.log(`ok   ${name} (${((Date.now() - start) / 1000).toFixed(1)} s)`);
  } catch (error) {
    failed += 1;
    console.log(`FAIL ${name} (${((Date.now() - start) / 1000).toFixed(1)} s)\n${error.stack}`);
    await browser.closePages();
    if (!server.running) await server.restart();
  }
}
await browser.stop();
await server.stop();
rmSync(scratch, { recursive: true });
console.log(failed ? `${failed} failed` : "all passed");
process.exit(failed ? 1 : 0);
