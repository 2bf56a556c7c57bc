"""JPEG 2000 and JPEG XL on the eigen-textures, at the relative errors at which Eigentile's archives are measured.

    python codec_peers.py measure V.npy -o PEERS.json [--targets 0.12,0.05,0.015] [--effort 9] [--jobs 2]
    python codec_peers.py speed PEERS.json [--runs 3]

V.npy is f32 [component][y][x], the finest mip only, as `eigentile bench codec --keep` writes it. `measure` codes it
in several ways, searches each one's quality so that sqrt(sum((decoded - v)^2) / sum(v^2)), in f64 over all components,
is the target or up to 0.2 % less, and keeps the way with the fewest bytes; its streams are written beside PEERS.json.
`speed` decodes these streams with one thread, and prints the median of some runs as JSON.

All ways put one scale on all components, so that a squared error costs the same in each of them: what minimizes bytes
at a given sum of squares.

JPEG 2000 (OpenJPEG): irreversible 9/7 wavelet, five decompositions, blocks of 64 x 64, 16-bit samples, no container, no
colour transform, one layer.
  together   one codestream whose components are the eigen-textures: the rate control truncates all their code blocks
             at one common slope of distortion over bytes
  separate   a codestream for each component, the same distortion in each
JPEG XL (libjxl), f32 or 16-bit samples, no container:
  vardct-3   a file for each component, one distance for all. Lossy JPEG XL works on cube roots of linear light (XYB);
             values are mapped so that the cube roots are linear in them, which makes its error uniform. Effort 3 has no
             perceptual masking, which costs squared error: efforts 5, 7 and 9 need 3 to 20 % more bytes
  modular    samples quantized with one step, then lossless in one file with a channel for each component, --effort
"""

import argparse
import concurrent.futures
import json
import pathlib
import sys
import time

import imagecodecs
import numpy as np

from program import median, write_json

TOLERANCE = 0.002
MAX_TRIALS = 14
# JPEG XL's bias of the cube root of linear light (opsin absorbance).
BIAS = 0.0037930732552754493
ROOT_OF_BIAS = np.cbrt(BIAS)
CUBE_SPAN = np.cbrt(1 + BIAS) - ROOT_OF_BIAS


class Together:
    """JPEG 2000: one codestream. `loss` is 10^(-PSNR/20)."""

    start = 1e-3

    def __init__(self, v):
        self.scale = float(np.abs(v).max()) or 1.0
        self.samples = np.clip(np.rint(v / self.scale * 32767) + 32768, 0, 65535).astype(np.uint16)

    def options(self, loss):
        level = -20 * np.log10(loss)
        return dict(level=level, codecformat="j2k", reversible=False, mct=False, numthreads=1)

    def encode(self, loss):
        return [imagecodecs.jpeg2k_encode(self.samples, planar=True, **self.options(loss))]

    @staticmethod
    def decode_raw(streams):
        return [imagecodecs.jpeg2k_decode(stream, planar=True, numthreads=1) for stream in streams]

    def values(self, raw):
        return (np.reshape(raw, self.samples.shape).astype(np.float64) - 32768) / 32767 * self.scale


class Separate(Together):
    """JPEG 2000: a codestream for each component."""

    def encode(self, loss):
        return [imagecodecs.jpeg2k_encode(image, **self.options(loss)) for image in self.samples]

    @staticmethod
    def decode_raw(streams):
        return [imagecodecs.jpeg2k_decode(stream, numthreads=1) for stream in streams]


class VarDct:
    """JPEG XL, lossy; `loss` is the distance."""

    start = 0.1

    def __init__(self, v, effort):
        self.scale = float(np.abs(v).max()) or 1.0
        cube_root = (v / self.scale * 0.5 + 0.5) * CUBE_SPAN + ROOT_OF_BIAS
        self.samples = (cube_root.astype(np.float64) ** 3 - BIAS).astype(np.float32)
        self.effort = effort

    def encode(self, loss):
        if not 0.01 <= loss <= 25:
            return None
        options = dict(distance=float(loss), effort=self.effort, numthreads=1)
        return [imagecodecs.jpegxl_encode(image, **options) for image in self.samples]

    @staticmethod
    def decode_raw(streams):
        return [imagecodecs.jpegxl_decode(stream, numthreads=1) for stream in streams]

    def values(self, raw):
        cube_root = np.cbrt(np.reshape(raw, self.samples.shape).astype(np.float64) + BIAS)
        return ((cube_root - ROOT_OF_BIAS) / CUBE_SPAN - 0.5) * 2 * self.scale


class Modular:
    """JPEG XL, lossless after a quantizer; `loss` is the step in root mean squares of all values."""

    start = 0.3

    def __init__(self, v, effort):
        self.v = v
        self.scale = float(np.sqrt((v.astype(np.float64) ** 2).mean())) or 1.0
        self.effort = effort

    def quantized(self, loss):
        levels = np.rint(self.v / (loss * self.scale)).astype(np.int64)
        lowest = levels.min(axis=(1, 2), keepdims=True)
        return levels, lowest

    def error_without_coding(self, loss):
        """What is lost is lost in the quantizer, so the search need not code."""
        return self.quantized(loss)[0] * (loss * self.scale)

    def encode(self, loss):
        levels, lowest = self.quantized(loss)
        samples = levels - lowest
        if samples.max() > 65535:
            return None
        samples = samples.astype(np.uint8 if samples.max() < 256 else np.uint16)
        self.lowest, self.step = lowest, loss * self.scale
        return [imagecodecs.jpegxl_encode(samples, lossless=True, planar=True, effort=self.effort, numthreads=1)]

    decode_raw = staticmethod(VarDct.decode_raw)

    def values(self, raw):
        return (np.reshape(raw, self.v.shape).astype(np.float64) + self.lowest) * self.step


DECODERS = {"together": Together, "separate": Separate, "vardct-3": VarDct, "modular": Modular}
PEERS = {"jpeg2000": ["together", "separate"], "jpegxl": ["vardct-3", "modular"]}


def coder_of(mode, v, effort):
    if mode == "modular":
        return Modular(v, effort)
    if mode.startswith("vardct"):
        return VarDct(v, int(mode.rpartition("-")[2]))
    return DECODERS[mode](v)


def relative_error(values, v):
    difference = values - v.astype(np.float64)
    return float(np.sqrt((difference**2).sum() / (v.astype(np.float64) ** 2).sum()))


def meet(target, start, error_of):
    """The largest loss whose error is at most `target`: a regula falsi of logarithms, bisection every third time. None if
    the coder takes no such loss."""
    below = above = None
    for trial in range(MAX_TRIALS):
        if below and below[1] >= target * (1 - TOLERANCE):
            break
        if below and above:
            aim = np.log(target * (1 - TOLERANCE / 2))
            (a, error_a), (b, error_b) = below, above
            share = (aim - np.log(error_a)) / (np.log(error_b) - np.log(error_a)) if trial % 3 != 2 else 0.5
            loss = a * (b / a) ** np.clip(share, 0.02, 0.98)
        elif below or above:
            loss, error = below or above
            loss *= np.clip(target / max(error, 1e-9), 1.5, 8) if below else np.clip(target / error, 0.125, 0.67)
        else:
            loss = start
        error = error_of(loss)
        if error is None:
            return below
        if error <= target:
            below = (loss, error)
        else:
            above = (loss, error)
    return below


def code(v_path, mode, target, effort):
    """One way of coding at one target: a row of the table, and the streams; None where it cannot meet the target."""
    v = np.load(v_path)
    coder = coder_of(mode, v, effort)

    def error_of(loss):
        if hasattr(coder, "error_without_coding"):
            return relative_error(coder.error_without_coding(loss), v)
        streams = coder.encode(loss)
        return None if streams is None else relative_error(coder.values(coder.decode_raw(streams)), v)

    found = meet(target, coder.start * target / 0.1, error_of)
    if found is None:
        return None
    began = time.perf_counter()
    streams = coder.encode(found[0])
    if streams is None:
        return None
    seconds = time.perf_counter() - began
    # Measured again, on what is decoded from the very streams that are counted.
    error = relative_error(coder.values(coder.decode_raw(streams)), v)
    size = sum(map(len, streams))
    row = {
        "mode": mode,
        "loss": float(found[0]),
        "relative_error": error,
        "bytes": size,
        "bits_per_sample": 8 * size / v.size,
        "encode_seconds": seconds,
        "meets_target": error <= target * 1.0001,
    }
    return row, streams


def measure(arguments):
    v = np.load(arguments.v, mmap_mode="r")
    output = pathlib.Path(arguments.output)
    jobs = [(peer, target, mode) for peer in PEERS for target in arguments.targets for mode in PEERS[peer]]
    with concurrent.futures.ProcessPoolExecutor(arguments.jobs) as pool:
        futures = [pool.submit(code, arguments.v, mode, target, arguments.effort) for _, target, mode in jobs]
        results = [future.result() for future in futures]
    report = {"imagecodecs": imagecodecs.__version__, "libraries": libraries(), "samples": int(v.size), "peers": {}}
    for peer in PEERS:
        report["peers"][peer] = []
        for target in arguments.targets:
            rows = [result for job, result in zip(jobs, results) if job[:2] == (peer, target) and result]
            rows = [(row, streams) for row, streams in rows if row["meets_target"]]
            if not rows:
                print(f"{peer}: no way to meet {target}", file=sys.stderr)
                continue
            best, streams = min(rows, key=lambda row: row[0]["bytes"])
            file = output.with_name(f"{peer}-{target}.bin")
            file.write_bytes(b"".join(streams))
            point = {"target": target, **best, "streams": file.name, "stream_bytes": [len(stream) for stream in streams]}
            point["modes"] = [row for row, _ in rows]
            report["peers"][peer].append(point)
            print(f"{peer} {target}: {best['bits_per_sample']:.3f} bits, {best['mode']}", file=sys.stderr)
    write_json(output, report)


def libraries():
    known = imagecodecs.version(dict)
    return {name: known.get(name) for name in ("openjpeg", "libjxl")}


def speed(arguments):
    path = pathlib.Path(arguments.report)
    report = json.loads(path.read_text())
    speeds = []
    for peer, points in report["peers"].items():
        for point in points:
            data, streams, at = path.with_name(point["streams"]).read_bytes(), [], 0
            for length in point["stream_bytes"]:
                streams.append(data[at : at + length])
                at += length
            decode = DECODERS[point["mode"]].decode_raw
            seconds = []
            for _ in range(arguments.runs):
                began = time.perf_counter()
                decode(streams)
                seconds.append(time.perf_counter() - began)
            seconds = median(seconds)
            speeds.append(
                {"peer": peer, "target": point["target"], "seconds": seconds, "mb_per_s": 4e-6 * report["samples"] / seconds}
            )
    print(json.dumps(speeds))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    command = commands.add_parser("measure", help="bytes at each target")
    command.add_argument("v", metavar="V.npy")
    command.add_argument("-o", "--output", required=True, metavar="PEERS.json")
    command.add_argument("--targets", type=lambda text: [float(part) for part in text.split(",")], default=[0.12, 0.05, 0.015])
    command.add_argument("--effort", type=int, default=9, help="of lossless JPEG XL; 9 takes minutes for 512 x 512 x 100")
    command.add_argument("--jobs", type=int, default=1, help="ways that are coded at the same time")
    command.set_defaults(run=measure)
    command = commands.add_parser("speed", help="decoding with one thread")
    command.add_argument("report", metavar="PEERS.json")
    command.add_argument("--runs", type=int, default=3)
    command.set_defaults(run=speed)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
