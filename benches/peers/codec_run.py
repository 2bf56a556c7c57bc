"""Measures the page codec beside JPEG 2000 and JPEG XL on synthetic materials: one command for the whole table.

    python codec_run.py --work DIR [--materials cloth,wool] [--sizes 256,512] [--again ours,speed] [--program P]

For each material and size, in a folder of DIR: synthesize the BTF and factorize it (once: the BTF, 2.6 GB at 256 x 256
and 10 GB at 512 x 512, is deleted when the factors are kept), code archives (ours.json), code V with the peers
(peers.json), then decode both alternately, one thread each (speed.json). What has a file is not done again, so the
command can be stopped and called again at any time; `--again` does steps again, from the kept factors. After each
material benches/results/codec.json is merged, and plots are drawn anew (report.py); tables: `cargo xtask report`.
"""

import argparse
import pathlib
import sys

from program import RESULTS, add_program_argument, json_of, machine, median, output_of, python, read_json, write_json

MATERIALS = ["cloth", "wool", "leather", "sponge", "gravel", "studs"]


def ours(arguments, name, size, folder):
    """Archives at all targets; factors first where there are none."""
    btf = folder.parent / f"{folder.name}.npy"
    source = folder
    if not (folder / "factors.json").exists():
        source = btf
        if not (btf.exists() and btf.with_suffix(".json").exists()):
            command = [arguments.program, "synth", name, "-o", btf, "--size", size, "--sampling", arguments.sampling]
            output_of([*command, "--seed", "1"])
    command = [arguments.program, "bench", "codec", source, "--keep", folder.parent, "--json"]
    report = json_of([*command, "--components", arguments.components, "--targets", arguments.targets])
    if source == btf and not arguments.keep_btf:
        btf.unlink()
        btf.with_suffix(".json").unlink()
    return {"generator": report["generator"], "machine": machine(), **report["materials"][0]}


def peers(arguments, folder):
    part = folder / "peers-unfinished.json"
    output_of(
        python("codec_peers.py", "measure", folder / "v.npy", "-o", part, "--targets", arguments.targets)
        + ["--effort", arguments.effort, "--jobs", arguments.jobs]
    )
    report = read_json(part)
    part.unlink()
    return report


def speed(arguments, folder, material):
    """Decoding, ours and theirs alternately: every figure is the median of its rounds, every ratio of ratios."""
    archives = [point["archive"] for point in material["points"]]
    rounds = []
    for _ in range(arguments.rounds):
        decoded = json_of([arguments.program, "bench", "decode", *archives, "--runs", 3, "--json"])
        theirs = json_of(python("codec_peers.py", "speed", folder / "peers.json"))
        speeds = {(row["peer"], row["target"]): row["mb_per_s"] for row in theirs}
        rounds.append([(row["decode"], speeds) for row in decoded])
    rows = []
    for i, point in enumerate(material["points"]):
        target = point["target"]
        pairs = [one[i] for one in rounds]
        row = {"target": target, "rounds": arguments.rounds}
        for name in ("mb_per_s", "finest_mb_per_s"):
            row[name] = median([decode[name] for decode, _ in pairs])
        for peer in sorted({peer for peer, at in pairs[0][1] if at == target}):
            row[f"{peer}_mb_per_s"] = median([speeds[peer, target] for _, speeds in pairs])
            for name, ratio in (("mb_per_s", "ratio"), ("finest_mb_per_s", "finest_ratio")):
                ratios = [decode[name] / speeds[peer, target] for decode, speeds in pairs]
                row[f"{ratio}_to_{peer}"] = median(ratios)
        rows.append(row)
    return rows


def merge(folder, output):
    """Puts a material into the table of results: for each target ours, the peers', ratios."""
    material, theirs = read_json(folder / "ours.json"), read_json(folder / "peers.json")
    speeds = {row["target"]: row for row in read_json(folder / "speed.json")}
    rows = []
    for point in material.pop("points"):
        target = point["target"]
        row = {key: value for key, value in point.items() if key not in ("archive", "decode")}
        row["decode"] = speeds[target]
        row["peers"] = {}
        for peer, points in theirs["peers"].items():
            for other in points:
                if other["target"] != target:
                    continue
                kept = {key: value for key, value in other.items() if key not in ("streams", "stream_bytes", "target")}
                kept["bytes_ratio"] = (point["page_bytes"] + point["table_bytes"]) / other["bytes"]
                kept["archive_bytes_ratio"] = point["archive_bytes"] / other["bytes"]
                row["peers"][peer] = kept
        rows.append(row)
    material["points"] = rows
    material["libraries"] = theirs["libraries"]
    results = read_json(output, {"materials": []})
    kept = [other for other in results["materials"] if other["name"] != material["name"]]
    results["materials"] = sorted([*kept, material], key=lambda other: (other["width"], other["name"]))
    write_json(output, results)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_program_argument(parser)
    parser.add_argument("--work", type=pathlib.Path, required=True, metavar="DIR", help="factors, archives, steps done")
    parser.add_argument("--materials", default=",".join(MATERIALS))
    parser.add_argument("--sizes", default="256,512")
    parser.add_argument("--sampling", default="bonn81")
    parser.add_argument("--components", type=int, default=100)
    parser.add_argument("--targets", default="0.12,0.05,0.015")
    parser.add_argument("--effort", type=int, default=9, help="of lossless JPEG XL")
    parser.add_argument("--jobs", type=int, default=2, help="peers that code at the same time")
    parser.add_argument("--rounds", type=int, default=3, help="of decoding, ours and theirs alternately")
    parser.add_argument("--again", default="", help="steps to do again: ours, peers, speed")
    parser.add_argument("--keep-btf", action="store_true", help="do not delete BTFs that were factorized")
    parser.add_argument("--results", type=pathlib.Path, default=RESULTS / "codec.json")
    arguments = parser.parse_args()
    again = set(filter(None, arguments.again.split(",")))
    if again - {"ours", "peers", "speed"}:
        sys.exit(f"error: --again {arguments.again}: the steps are ours, peers and speed")
    # What an archive or a stream is has changed: so has its speed.
    again |= {"speed"} if again else set()
    arguments.work = arguments.work.resolve()
    arguments.work.mkdir(parents=True, exist_ok=True)
    for size in arguments.sizes.split(","):
        for name in arguments.materials.split(","):
            folder = arguments.work / f"{name}-{size}"
            folder.mkdir(exist_ok=True)
            print(f"== {folder.name}", file=sys.stderr)
            steps = {
                "ours": lambda: ours(arguments, name, size, folder),
                "peers": lambda: peers(arguments, folder),
                "speed": lambda: speed(arguments, folder, read_json(folder / "ours.json")),
            }
            for step, work in steps.items():
                path = folder / f"{step}.json"
                if step in again or not path.exists():
                    write_json(path, work())
            merge(folder, arguments.results)
    if arguments.results == RESULTS / "codec.json":
        output_of(python("report.py"))


if __name__ == "__main__":
    main()
