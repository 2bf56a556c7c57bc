"""Multiplies an export's u.npy and v.npy and compares the product with the BTF it came from.

    python check_export.py BTF.npy EXPORT_DIR [--block-rows 512]

Prints one JSON object: the measured relative error |B - u v| / |B| with norms in f64, the error that meta.json
states, and their ratio. Exit code 1 if they differ by more than --tolerance (default 2 %).
"""

import argparse
import json
import pathlib
import sys

import numpy as np


def measure(btf, folder, block_rows):
    samples = np.load(btf, mmap_mode="r")
    rows, columns = int(np.prod(samples.shape[:3])), int(np.prod(samples.shape[3:]))
    matrix = samples.reshape(rows, columns)
    u = np.load(folder / "u.npy")
    v = np.load(folder / "v.npy")
    assert u.shape == (len(u), *samples.shape[:3]), f"u.npy has shape {u.shape}, the BTF {samples.shape}"
    assert v.shape == (len(u), *samples.shape[3:]), f"v.npy has shape {v.shape}, the BTF {samples.shape}"
    u, v = u.reshape(len(u), rows), v.reshape(len(v), columns)
    energy = difference = 0.0
    for start in range(0, rows, block_rows):
        block = matrix[start : start + block_rows].astype(np.float32)
        energy += float(np.square(block, dtype=np.float64).sum())
        block -= u[:, start : start + block_rows].T @ v
        difference += float(np.square(block, dtype=np.float64).sum())
    return float(np.sqrt(difference / energy)) if energy > 0 else 0.0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("btf", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--block-rows", type=int, default=512)
    parser.add_argument("--tolerance", type=float, default=0.02)
    arguments = parser.parse_args()
    stated = json.loads((arguments.folder / "meta.json").read_text())["relative_error"]
    measured = measure(arguments.btf, arguments.folder, arguments.block_rows)
    ratio = measured / stated if stated > 0 else (1.0 if measured == 0 else float("inf"))
    print(json.dumps({"relative_error": measured, "stated_relative_error": stated, "ratio": ratio}, indent=2))
    sys.exit(0 if abs(ratio - 1) <= arguments.tolerance else 1)


if __name__ == "__main__":
    main()
