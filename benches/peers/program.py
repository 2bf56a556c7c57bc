"""What the scripts here share: running programs, describing the machine, JSON that is complete or not there."""

import json
import os
import pathlib
import platform
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
REPOSITORY = HERE.parent.parent
RESULTS = HERE.parent / "results"


def add_program_argument(parser):
    parser.add_argument(
        "--program",
        default=str(REPOSITORY / "target/release/eigentile"),
        help="the program eigentile; without it that of `cargo build --release`",
    )


def output_of(command):
    """Runs a command, its progress on our standard error; what it printed. Fails if it fails."""
    command = [str(part) for part in command]
    print("+", " ".join(command), file=sys.stderr, flush=True)
    done = subprocess.run(command, stdout=subprocess.PIPE, check=False)
    if done.returncode != 0:
        sys.exit(f"error: {command[0]} ended with {done.returncode}; see above")
    return done.stdout


def json_of(command):
    return json.loads(output_of(command))


def python(script, *arguments):
    """A command that runs a script beside this one with the same Python."""
    return [sys.executable, HERE / script, *arguments]


def read_json(path, otherwise=None):
    path = pathlib.Path(path)
    return json.loads(path.read_text()) if path.exists() else otherwise


def write_json(path, value):
    write_text(path, json.dumps(value, indent=1) + "\n")


def write_text(path, text):
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    part.write_text(text)
    part.replace(path)


def machine():
    """Where a figure was measured."""
    model = platform.processor() or platform.machine()
    cpuinfo = pathlib.Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if line.startswith("model name")]
        model = names[0] if names else model
    commit = subprocess.run(
        ["git", "-C", REPOSITORY, "describe", "--always", "--dirty"], capture_output=True, text=True, check=False
    )
    return {
        "processor": model,
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": platform.platform(terse=True),
        "commit": commit.stdout.strip() or None,
    }


def median(values):
    ordered = sorted(values)
    return ordered[len(ordered) // 2]
