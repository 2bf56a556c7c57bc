"""Rank-C truncated SVD of a BTF with numpy, to compare with `eigentile bench factorize`, from the same file.

    python factorize_numpy.py BTF.npy [--components 100] [--oversampling 10] [--power-iterations 2] [--block-rows 512]

The file is memory-mapped and read in blocks of rows; each block is converted to f32 once a pass and used for two
products, Z += B_i^T (B_i Q). Bases are orthonormalized by Householder QR between the passes (numpy.linalg.qr). The
relative error is sqrt(|B|^2 - |B Q|^2) / |B|, norms in f64. Prints one JSON object: seconds by phase, error, sizes.
"""

import argparse
import json
import resource
import time

import numpy as np


class Stopwatch:
    """Adds up seconds by phase."""

    def __init__(self):
        self.seconds = {}

    def __call__(self, phase, work):
        began = time.perf_counter()
        result = work()
        self.seconds[phase] = self.seconds.get(phase, 0.0) + time.perf_counter() - began
        return result


def anonymous_bytes():
    """Memory that no file backs; 0 where the system does not say."""
    try:
        with open("/proc/self/status") as status:
            lines = [line for line in status if line.startswith("RssAnon:")]
    except OSError:
        lines = []
    return int(lines[0].split()[1]) * 1024 if lines else 0


def blocks(matrix, block_rows, watch, buffer):
    """Yields (first row, block as f32) for all blocks of rows."""
    for start in range(0, matrix.shape[0], block_rows):
        samples = matrix[start : start + block_rows]
        block = buffer[: len(samples)]
        watch("read", lambda: np.copyto(block, samples))
        yield start, block


def factorize(path, components, oversampling, power_iterations, block_rows, seed):
    watch = Stopwatch()
    began = time.perf_counter()
    samples = np.load(path, mmap_mode="r")
    rows, columns = int(np.prod(samples.shape[:3])), int(np.prod(samples.shape[3:]))
    matrix = samples.reshape(rows, columns)
    width = min(components + oversampling, rows, columns)
    buffer = np.empty((min(block_rows, rows), columns), np.float32)
    energy, flops, peak_anonymous = None, 0.0, 0

    start = np.random.default_rng(seed).uniform(-1, 1, (columns, width)).astype(np.float32)
    q = watch("basis", lambda: np.linalg.qr(start)[0])
    for _ in range(power_iterations):
        z = np.zeros((columns, width), np.float32)
        block_energy = 0.0
        for _, block in blocks(matrix, block_rows, watch, buffer):
            if energy is None:
                block_energy += watch("norm", lambda: float(np.einsum("ij,ij->i", block, block, dtype=np.float64).sum()))
            y = watch("product", lambda: block @ q)
            watch("product", lambda: np.add(z, block.T @ y, out=z))
        energy = block_energy if energy is None else energy
        flops += 4.0 * rows * columns * width
        q = watch("basis", lambda: np.linalg.qr(z)[0])
        peak_anonymous = max(peak_anonymous, anonymous_bytes())

    y = np.empty((rows, width), np.float32)
    block_energy = 0.0
    for start, block in blocks(matrix, block_rows, watch, buffer):
        if energy is None:
            block_energy += watch("norm", lambda: float(np.einsum("ij,ij->i", block, block, dtype=np.float64).sum()))
        watch("product", lambda: np.matmul(block, q, out=y[start : start + len(block)]))
    energy = block_energy if energy is None else energy
    flops += 2.0 * rows * columns * width

    def decompose():
        u, singular_values, w = np.linalg.svd(y.astype(np.float64), full_matrices=False)
        kept = min(components, width)
        u = (u[:, :kept] * np.sqrt(rows)).astype(np.float32)
        v = (q @ w[:kept].T.astype(np.float32)) * (singular_values[:kept] / np.sqrt(rows)).astype(np.float32)
        return (u, singular_values[:kept], v), anonymous_bytes()

    (_, singular_values, _), anonymous = watch("decompose", decompose)
    peak_anonymous = max(peak_anonymous, anonymous)
    residual = max(energy - float((singular_values**2).sum()), 0.0)
    return {
        "program": f"numpy {np.__version__}",
        "rows": rows,
        "columns": columns,
        "components": len(singular_values),
        "passes": power_iterations + 1,
        "seconds": time.perf_counter() - began,
        "seconds_by_phase": watch.seconds,
        "gflops": flops / watch.seconds["product"] * 1e-9,
        "relative_error": float(np.sqrt(residual / energy)) if energy > 0 else 0.0,
        "singular_values": singular_values.tolist(),
        "peak_rss_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        "peak_anonymous_bytes": peak_anonymous,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("btf")
    parser.add_argument("--components", type=int, default=100)
    parser.add_argument("--oversampling", type=int, default=10)
    parser.add_argument("--power-iterations", type=int, default=2)
    parser.add_argument("--block-rows", type=int, default=512)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    report = factorize(
        arguments.btf,
        arguments.components,
        arguments.oversampling,
        arguments.power_iterations,
        arguments.block_rows,
        arguments.seed,
    )
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
