// Chromium with WebGPU by SwiftShader, and pages that must not complain.

import assert from "node:assert/strict";
import { existsSync } from "node:fs";
import { chromium } from "playwright-core";

/** The compositor has to be Vulkan's, too: pictures of WebGPU would not reach it otherwise. */
const FLAGS = ["--headless=new", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync", "--enable-unsafe-webgpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
  "--ignore-gpu-blocklist", "--enable-gpu", "--enable-features=Vulkan", "--use-vulkan=swiftshader"];
const PLACES = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome",
  "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome"];

export class Browser {
  #browser;
  #complaints = new Map();

  static async start() {
    const executablePath = PLACES.find((path) => path && existsSync(path));
    if (!executablePath) throw new Error("no Chromium: install it, or set CHROMIUM to its program");
    const browser = new Browser();
    browser.#browser = await chromium.launch({ executablePath, args: FLAGS });
    return browser;
  }

  /** What belongs together: pages share what is kept. */
  async context(options = {}) {
    return this.#browser.newContext({ viewport: { width: 800, height: 600 }, ...options });
  }

  /** A page alone. Unless it is not `quiet`, `done` fails for anything in its console; `allow` is what may be there. */
  async page({ quiet = true, allow, ...options } = {}) {
    const page = await (await this.context(options)).newPage();
    const complaints = [];
    const add = (text) => { if (!allow?.test(text)) complaints.push(text); };
    page.on("console", (message) => {
      if (["error", "warning"].includes(message.type())) add(`${message.text()} ${message.location().url}`);
    });
    page.on("pageerror", (error) => add(error.stack));
    if (quiet) this.#complaints.set(page, complaints);
    return page;
  }

  async done(...pages) {
    for (const page of pages) {
      assert.deepEqual(this.#complaints.get(page), []);
      await page.context().close();
    }
  }

  /** Holds back requests for records, which come after the beginning of an archive, until they are released. */
  async hold(page) {
    const held = { failed: [] };
    const released = new Promise((resolve) => { held.release = resolve; });
    page.on("requestfailed", (request) => held.failed.push(request.url()));
    await page.route(/\.bsvtf$/, async (route) => {
      if (!route.request().headers().range?.startsWith("bytes=0-")) await released;
      await route.continue().catch(() => {}); // given up meanwhile
    });
    return held;
  }

  async closePages() { for (const context of this.#browser.contexts()) await context.close(); }

  async stop() { await this.#browser.close(); }
}
