// The program's own server, which can be stopped and started again; and a host that knows nothing but files and ranges.

import { spawn } from "node:child_process";
import { createReadStream, statSync } from "node:fs";
import { createServer } from "node:http";
import { extname, join, normalize } from "node:path";
import { createInterface } from "node:readline";

export class Server {
  #arguments;
  #child;

  static async start(program, folder, dist) {
    const server = new Server();
    server.#arguments = [program, folder, dist];
    await server.#listen("127.0.0.1:0");
    return server;
  }

  async #listen(address) {
    const [program, folder, dist] = this.#arguments;
    this.#child = spawn(program, ["serve", folder, "--site", dist, "--listen", address, "--json"],
      { stdio: ["ignore", "pipe", "inherit"], env: { ...process.env, RUST_LOG: "error" } });
    const gone = new Promise((_, reject) => {
      this.#child.once("exit", (code) => reject(new Error(`the server ended with ${code}`)));
      this.#child.once("error", reject);
    });
    gone.catch(() => {});
    const first = new Promise((resolve) => {
      let text = "";
      createInterface({ input: this.#child.stdout }).on("line", (line) => {
        text += line;
        try { resolve(JSON.parse(text)); } catch { /* more is to come */ }
      });
    });
    ({ address: this.address } = await Promise.race([first, gone]));
  }

  get running() { return this.#child !== undefined; }

  /** Ends it, connections and all. */
  async stop() {
    const child = this.#child;
    this.#child = undefined;
    if (!child) return;
    const ended = new Promise((resolve) => { child.once("exit", resolve); });
    child.kill("SIGKILL");
    await ended;
  }

  /** Starts it at the same address. */
  async restart() { await this.#listen(new URL(this.address).host); }
}

const TYPES = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".wasm": "application/wasm", ".json": "application/json",
  ".svg": "image/svg+xml" };

export class StaticHost {
  /** Answers that were parts of files. */
  ranges = 0;
  #server;

  /** Folders by the paths under which they are, and single documents by theirs. */
  static async start(folders, documents) {
    const host = new StaticHost();
    host.#server = createServer((request, response) => host.#answer(request, response, folders, documents));
    await new Promise((resolve) => { host.#server.listen(0, "127.0.0.1", resolve); });
    host.address = `http://127.0.0.1:${host.#server.address().port}`;
    return host;
  }

  #answer(request, response, folders, documents) {
    const path = normalize(decodeURIComponent(new URL(request.url, "http://host").pathname));
    const type = TYPES[extname(path)] ?? (path.endsWith("/") ? "text/html" : "application/octet-stream");
    if (documents[path]) return response.writeHead(200, { "content-type": type }).end(documents[path]);
    const prefix = Object.keys(folders).filter((prefix) => path.startsWith(prefix)).sort((a, b) => b.length - a.length)[0];
    const file = join(folders[prefix], path.slice(prefix.length), path.endsWith("/") ? "index.html" : "");
    const { size, mtime } = statSync(file, { throwIfNoEntry: false }) ?? {};
    if (size === undefined) return response.writeHead(404).end();
    const fields = { "content-type": type, "last-modified": mtime.toUTCString(), "accept-ranges": "bytes" };
    const range = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? "");
    if (!range) {
      response.writeHead(200, { ...fields, "content-length": size });
      return createReadStream(file).pipe(response);
    }
    this.ranges += 1;
    const [start, end] = [Number(range[1]), Math.min(Number(range[2]), size - 1)];
    response.writeHead(206, { ...fields, "content-length": end - start + 1, "content-range": `bytes ${start}-${end}/${size}` });
    return createReadStream(file, { start, end }).pipe(response);
  }

  async stop() {
    this.#server.closeAllConnections();
    await new Promise((resolve) => { this.#server.close(resolve); });
  }
}
