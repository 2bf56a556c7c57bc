// Asks for the engine before the modules that use it are there; for nothing where there is no WebGPU. No module, so that it runs first.

if (navigator.gpu) {
  // The viewer takes it from here. Not a preload, of which browsers complain where loading the page takes long.
  globalThis.eigentileEngine = fetch("eigentile-viewer/engine_bg.wasm");
  globalThis.eigentileEngine.catch(() => {}); // told by the viewer
  document.head.append(Object.assign(document.createElement("link"), { crossOrigin: "", rel: "modulepreload", href: "eigentile-viewer/engine.js" }));
}
