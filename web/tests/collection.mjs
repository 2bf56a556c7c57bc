// What is shown in the tests: two small materials, made by the program itself and kept for the next run, and two scenes of them.

import { spawnSync } from "node:child_process";
import { existsSync, mkdirSync, renameSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";

const MATERIALS = ["cloth", "gravel"];
const TEXELS = 256;
const COMPONENTS = 16;

/** Makes the folder, if it is not there, and returns it. */
export function makeCollection(program, parent) {
  const folder = join(parent, `collection-${TEXELS}-${COMPONENTS}`);
  mkdirSync(folder, { recursive: true });
  for (const name of MATERIALS) {
    const archive = join(folder, `${name}.bsvtf`);
    // One of an older format is made anew.
    if (existsSync(archive) && spawnSync(program, ["inspect", archive]).status === 0) continue;
    const samples = join(parent, `${name}.npy`);
    run(program, ["synth", name, "--size", String(TEXELS), "--sampling", "sparse31", "--output", samples]);
    run(program, ["preprocess", samples, "--components", String(COMPONENTS), "--output", `${archive}.new`]);
    renameSync(`${archive}.new`, archive);
    rmSync(samples);
    rmSync(samples.replace(/npy$/, "json"));
  }
  const sun = { type: "directional", color: [1, 0.95, 0.85], intensity: 3 };
  const lamp = { type: "point", color: [0.7, 0.85, 1], intensity: 2 };
  write(folder, "square", {
    squares: [{ archive: "cloth", at: [0, 0, 0], turn: [0, 0.13, 0, 0.99] }],
    lights: [{ light: sun, turn: [-0.38, 0.2, 0, 0.9] }],
    eye: [0.25, 0.1, 1.4],
  });
  write(folder, "pair", {
    squares: [{ archive: "cloth", at: [-2, 0.25, 0], turn: [0, 0, 0, 1] }, { archive: "gravel", at: [2, 0.25, 0], turn: [0, 0.1, 0, 0.99] }],
    lights: [{ light: sun, turn: [-0.3, -0.2, 0, 0.93] }, { light: lamp, at: [0.4, 1.2, 1.5] }],
    eye: [0, 0.5, 4.5],
  });
  for (const scene of ["square", "pair"]) {
    if (existsSync(join(folder, `${scene}.png`))) continue;
    const output = join(parent, "thumbnail");
    run(program, ["render", join(folder, `${scene}.gltf`), "--tiles", folder, "--size", "200x150", "--output", output]);
    renameSync(join(output, "settled.png"), join(folder, `${scene}.png`));
  }
  return folder;
}

function run(program, given) {
  const { status, stderr, error } = spawnSync(program, given, { encoding: "utf8" });
  if (status !== 0) throw new Error(`${program} ${given.join(" ")}: ${error ?? stderr}`);
}

/** A glTF scene of squares that stand upright; its buffer lies beside it. */
function write(folder, name, { squares, lights, eye }) {
  const corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
  const floats = new Float32Array([
    ...corners.flatMap(([x, y]) => [x, y, 0]), ...corners.flatMap(() => [0, 0, 1]), ...corners.flatMap(([x, y]) => [x + 0.5, 0.5 - y]),
  ]);
  const indices = new Uint16Array([0, 1, 2, 0, 2, 3]);
  const bytes = Buffer.concat([Buffer.from(floats.buffer), Buffer.from(indices.buffer)]);
  const view = (byteOffset, byteLength) => ({ buffer: 0, byteOffset, byteLength });
  const accessor = (bufferView, type, count, componentType = 5126) => ({ bufferView, type, count, componentType });
  const document = {
    asset: { version: "2.0" },
    extensionsUsed: ["EIGENTILE_materials_btf", "EIGENTILE_environment", "KHR_lights_punctual"],
    extensions: { KHR_lights_punctual: { lights: lights.map(({ light }) => light) } },
    scene: 0,
    scenes: [{
      nodes: [...squares, ...lights, eye].map((_, at) => at),
      extensions: { EIGENTILE_environment: { ambient: [0.15, 0.15, 0.18], background: [0.02, 0.03, 0.05] } },
    }],
    nodes: [
      ...squares.map(({ at, turn }, mesh) => ({ mesh, translation: at, rotation: turn })),
      ...lights.map(({ at = [0, 0, 0], turn = [0, 0, 0, 1] }, light) => (
        { translation: at, rotation: turn, extensions: { KHR_lights_punctual: { light } } })),
      { camera: 0, translation: eye },
    ],
    cameras: [{ type: "perspective", perspective: { yfov: 0.7, znear: 0.02 } }],
    meshes: squares.map((_, material) => ({ primitives: [{ attributes: { POSITION: 0, NORMAL: 1, TEXCOORD_0: 2 }, indices: 3, material }] })),
    materials: squares.map(({ archive }) => ({ name: archive, extensions: { EIGENTILE_materials_btf: { archive } } })),
    accessors: [{ ...accessor(0, "VEC3", 4), min: [-0.5, -0.5, 0], max: [0.5, 0.5, 0] }, accessor(1, "VEC3", 4), accessor(2, "VEC2", 4),
      accessor(3, "SCALAR", 6, 5123)],
    bufferViews: [view(0, 48), view(48, 48), view(96, 32), view(128, 12)],
    buffers: [{ byteLength: bytes.length, uri: `${name}.bin` }],
  };
  writeFileSync(join(folder, `${name}.bin`), bytes);
  writeFileSync(join(folder, `${name}.gltf`), JSON.stringify(document));
}
