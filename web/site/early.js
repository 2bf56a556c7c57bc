// Asks for the engine before the modules that use it are there; for nothing where there is no WebGPU. No module, so that it runs first.

if (navigator.gpu) {
  const link = (attributes) => document.head.append(Object.assign(document.createElement("link"), { crossOrigin: "", ...attributes }));
  link({ rel: "preload", href: "eigentile-viewer/engine_bg.wasm", as: "fetch", type: "application/wasm" });
  link({ rel: "modulepreload", href: "eigentile-viewer/engine.js" });
}
