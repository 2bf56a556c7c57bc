"""Factorizes synthetic BTFs with Eigentile and with numpy, alternately: one command for the whole table.

    python factorize_run.py --work DIR [--cases cloth:bonn81:256,cloth:ubo151:256] [--rounds 3] [--memory 1GiB]

A case is material:directions:texels. The BTFs (2.6 GB for 81 x 81 directions and 256 x 256 texels, 9 GB for 151 x 151) are
synthesized in DIR and deleted afterwards. Both programs map the file and read it in blocks of rows; the page cache
holds it where memory allows, so a first round, which is not counted, warms it for both (--cold leaves that out).
numpy needs about 0.7 GB of its own for the first case and 1 GB for the second (blocks of 512 rows, Q, Z, Y, the f64 SVD of
Y); mapped pages come on top of that in its peak RSS. Results go to benches/results/factorize.json, and from there into
docs/results.md (`cargo xtask report`). A case that has a result is done again.
"""

import argparse
import pathlib

from program import RESULTS, add_program_argument, json_of, machine, median, output_of, python, read_json, write_json


def measure(arguments, case):
    material, sampling, size = case.split(":")
    btf = arguments.work / f"{material}-{sampling}-{size}.npy"
    if not (btf.exists() and btf.with_suffix(".json").exists()):
        output_of(
            [arguments.program, "synth", material, "-o", btf, "--size", size, "--sampling", sampling, "--seed", "1"]
        )
    memory = ["--memory", arguments.memory] if arguments.memory else []
    our_command = [arguments.program, "bench", "factorize", btf, "--components", arguments.components, "--json", *memory]
    numpy_command = python("factorize_numpy.py", btf, "--components", str(arguments.components))
    runs = []
    for number in range(arguments.rounds + (0 if arguments.cold else 1)):
        run = {"eigentile": json_of(our_command), "numpy": json_of(numpy_command)}
        run["numpy"].pop("singular_values", None)
        if number > 0 or arguments.cold:
            runs.append(run)
    if not arguments.keep_btf:
        btf.unlink()
        btf.with_suffix(".json").unlink()
    summary = {
        key: {name: median([run[name][key] or 0 for run in runs]) for name in ("eigentile", "numpy")}
        for key in ("seconds", "relative_error", "gflops", "peak_rss_bytes", "peak_anonymous_bytes")
    }
    ratio = median([run["eigentile"]["seconds"] / run["numpy"]["seconds"] for run in runs])
    first = runs[0]["eigentile"]
    return {
        "case": case,
        "rows": first["rows"],
        "columns": first["columns"],
        "components": first["components"],
        "memory": arguments.memory,
        "machine": machine(),
        "seconds_ratio": ratio,
        **summary,
        "runs": runs,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_program_argument(parser)
    parser.add_argument("--work", type=pathlib.Path, required=True, metavar="DIR", help="where the BTFs are made")
    parser.add_argument("--cases", default="cloth:bonn81:256,cloth:ubo151:256")
    parser.add_argument("--components", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--memory", help="what Eigentile may use, such as 1GiB")
    parser.add_argument("--cold", action="store_true", help="count the first round too")
    parser.add_argument("--keep-btf", action="store_true", help="do not delete the BTFs")
    parser.add_argument("--results", type=pathlib.Path, default=RESULTS / "factorize.json")
    arguments = parser.parse_args()
    arguments.work = arguments.work.resolve()
    arguments.work.mkdir(parents=True, exist_ok=True)
    for case in arguments.cases.split(","):
        result = measure(arguments, case)
        results = read_json(arguments.results, {"cases": []})
        kept = [other for other in results["cases"] if other["case"] != case]
        write_json(arguments.results, {"cases": [*kept, result]})


if __name__ == "__main__":
    main()
