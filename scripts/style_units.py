#!/usr/bin/python3
"""Makes what clang-tidy reads in check_style.sh: FOLDER/compile_commands.json and the units that it names, whose paths are
printed, the largest first. Usage: style_units.py COMPILE_COMMANDS FOLDER"""
import json
import re
import subprocess
import sys
from pathlib import Path

UNITS = 2  # and one of the programs; the same on every machine: what is in a unit decides whether names meet


def files_of(entry):
    """Of a compile command; of a unit of a unity build the files in it."""
    path = Path(entry["directory"], entry["file"]).resolve()
    if not re.search(r"/Unity/unity_\d+(_cxx)?\.cxx$", str(path)):
        return [path]
    return [Path(name).resolve() for name in re.findall(r'#include "(.*)"', path.read_text())]


def main():
    commands, folder = Path(sys.argv[1]), Path(sys.argv[2])
    tracked = {Path(path).resolve() for path in subprocess.check_output(["git", "ls-files", "src"], text=True).split()}
    sources, flags = set(), {}
    for entry in json.loads(commands.read_text()):
        chosen = tracked.intersection(files_of(entry))
        sources |= chosen
        for flag in re.findall(r"(?:-I|-isystem|-D) ?\S+", entry["command"]) if chosen else []:
            flags.setdefault(flag.split("=")[0], flag)  # a macro has the first value that a target gives it
    texts = {source: source.read_text() for source in sorted(sources)}
    mains = [source for source, text in texts.items() if re.search(r"^int main\(", text, re.MULTILINE)]
    rest = [source for source in texts if source not in mains]
    units, total, done = [[] for _ in range(UNITS)], sum(len(texts[source]) for source in rest), 0
    for source in rest:  # equal parts by length
        units[done * UNITS // total].append(f'#include "{source}"\n')
        done += len(texts[source])
    # Each main has a name of its own.
    units.append([f'#define main main{at}\n#include "{source}"\n#undef main\n' for at, source in enumerate(mains)])
    entries = []
    for number, lines in enumerate(units):
        unit = folder / f"unit_{number}.cpp"
        unit.write_text("".join(lines))
        entries.append({"directory": str(folder), "file": str(unit),
                        "command": f"c++ -std=c++17 -fPIC -Wall -Wextra {' '.join(flags.values())} -c {unit}"})
    (folder / "compile_commands.json").write_text(json.dumps(entries))
    print(f"clang-tidy: {len(sources)} files in {len(units)} units", file=sys.stderr)
    print(*(entry["file"] for entry in entries), sep="\n")


if __name__ == "__main__":
    main()
