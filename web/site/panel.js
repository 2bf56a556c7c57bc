// The panel beside the picture: what can be set, and figures.

import { size } from "./collection.js";

const find = (id) => document.getElementById(id);
/** Points of the chart. */
const KEPT = 240;

/** Connects the panel to a viewer, which may be replaced by a later call. */
export function connect(viewer) {
  const course = [];
  const settings = find("settings");
  const said = (text) => { find("said").textContent = text; };
  settings.onsubmit = (event) => event.preventDefault();
  find("exposure").oninput = (event) => { viewer.exposure = Number(event.target.value); showExposure(viewer); };
  find("shape").onchange = (event) => { viewer.shape = event.target.value; };
  find("overlay").onchange = (event) => { viewer.overlay = event.target.value; showOverlay(viewer); };
  find("cache").oninput = (event) => { viewer.cacheBytes = 2 ** Number(event.target.value) * 2 ** 20; showCache(viewer); };
  settings.onclick = (event) => {
    const name = event.target.closest("[data-do]")?.dataset.do;
    if (name) viewer.command(name);
  };
  find("copy").onclick = async () => {
    try {
      await navigator.clipboard.writeText(location.href);
      said("The link is copied.");
    } catch {
      said("The browser does not allow it: copy the address of this page.");
    }
  };
  find("save").onclick = () => viewer.save().then(() => said("Saved."), (error) => said(error.message));
  const showSettings = () => {
    showExposure(viewer);
    showCache(viewer);
    find("shape-row").hidden = viewer.shape === undefined;
    if (viewer.shape) find("shape").value = viewer.shape;
    showOverlay(viewer);
  };
  viewer.addEventListener("open", showSettings);
  viewer.addEventListener("linkchange", showSettings);
  viewer.addEventListener("problem", (event) => said(event.detail));
  for (const name of ["progress", "firstpicture", "settled"]) {
    viewer.addEventListener(name, (event) => showFigures(event.detail, course));
  }
  said("");
  find("figures").replaceChildren();
}

function showExposure(viewer) {
  find("exposure").value = viewer.exposure;
  find("exposure-text").textContent = `${viewer.exposure.toFixed(1)} stops`;
}

function showOverlay(viewer) {
  const overlays = viewer.overlays;
  const select = find("overlay");
  find("overlay-row").hidden = overlays.length === 0;
  if (select.options.length !== overlays.length) {
    select.replaceChildren(...overlays.map(({ name, title }) => new Option(title || name, name)));
  }
  select.value = viewer.overlay;
  const legend = overlays.find(({ name }) => name === viewer.overlay)?.legend ?? [];
  find("legend").replaceChildren(...legend.map(({ label, colour }) => {
    const [item, mark] = [document.createElement("li"), document.createElement("i")];
    mark.style.background = colour;
    item.append(mark, label);
    return item;
  }));
}

function showCache(viewer) {
  if (!viewer.cacheBytes) return;
  find("cache").value = Math.log2(viewer.cacheBytes / 2 ** 20);
  find("cache-text").textContent = `${Math.round(viewer.cacheBytes / 2 ** 20)} MiB`;
}

function showFigures(report, course) {
  const { frame, source, gets } = report;
  const ms = ["votes", "residency", "source", "decode", "upload", "draw"].reduce((sum, phase) => sum + frame.ms[phase], 0);
  const gpu = frame.ms.gpu && Object.values(frame.ms.gpu).reduce((sum, pass) => sum + pass, 0);
  const rows = {
    Quality: `${Math.round(report.progress * 100)} %`,
    "Predicted error": frame.predicted_rms.toExponential(2),
    Loaded: size(frame.wire_bytes_total),
    "From the cache": size(source.from_disk_bytes),
    "Pages wanted": frame.pages_wanted,
    "Pages resident": frame.pages_resident,
    "Columns resident": frame.columns_resident,
    "To come": frame.in_flight,
    "Given up": gets.aborted,
    "On the GPU": size(frame.gpu_bytes),
    "Frame, CPU": `${ms.toFixed(1)} ms`,
    "Frame, GPU": gpu === null || gpu === undefined ? "–" : `${gpu.toFixed(1)} ms`,
    Size: report.size.join(" × "),
  };
  if (source.offline) rows.Server = "offline";
  const list = find("figures");
  const texts = Object.entries(rows).flatMap(([name, value]) => {
    const [term, data] = [document.createElement("dt"), document.createElement("dd")];
    [term.textContent, data.textContent] = [name, value];
    return [term, data];
  });
  list.replaceChildren(...texts);
  find("materials").replaceChildren(...report.materials.map(({ name, state, progress, wire_bytes: bytes, failure }) => {
    const item = document.createElement("li");
    const share = progress === null ? "" : ` ${Math.floor(progress * 100)} %,`;
    item.textContent = `${name}: ${state},${share} ${size(bytes)}${failure ? `: ${failure}` : ""}`;
    return item;
  }));
  if (find("json").closest("details").open) find("json").textContent = JSON.stringify(report, null, 1);
  course.push(frame.predicted_rms);
  if (course.length > KEPT) course.shift();
  const most = Math.max(...course, 1e-12);
  const points = course.map((rms, at) => `${at * 240 / Math.max(course.length - 1, 1)},${(58 - 56 * rms / most).toFixed(1)}`);
  find("chart").firstElementChild.setAttribute("points", points.join(" "));
}
