#!/usr/bin/python3
"""Makes what clang-tidy reads in check_style.sh: FOLDER/compile_commands.json and the units that it names, whose paths are
printed, the largest first. Usage: style_units.py COMPILE_COMMANDS FOLDER"""
import json
import os
import re
import subprocess
import sys

UNITS = 2  # and one of the programs; the same on every machine: what is in a unit decides whether names meet


def files_of(entry):
    """Of a compile command; of a unit of a unity build the files in it."""
    path = os.path.realpath(os.path.join(entry["directory"], entry["file"]))
    if not re.search(r"/Unity/unity_\d+(_cxx)?\.cxx$", path):
        return [path]
    with open(path) as file:
        return [os.path.realpath(name) for name in re.findall(r'#include "(.*)"', file.read())]


def is_main(path):
    with open(path) as file:
        return re.search(r"^int main\(", file.read(), re.MULTILINE)


def main():
    tracked = {os.path.realpath(path) for path in subprocess.check_output(["git", "ls-files", "src"], text=True).split()}
    sources, flags = set(), {}
    with open(sys.argv[1]) as file:
        compiled = json.load(file)
    for entry in compiled:
        chosen = tracked.intersection(files_of(entry))
        sources |= chosen
        for flag in re.findall(r"(?:-I|-isystem|-D) ?\S+", entry["command"]) if chosen else []:
            flags.setdefault(flag.split("=")[0], flag)  # a macro has the first value that a target gives it
    mains = sorted(filter(is_main, sources))
    rest = sorted(sources.difference(mains))
    units, total, done = [[] for _ in range(UNITS)] + [mains], sum(map(os.path.getsize, rest)), 0
    for source in rest:  # equal parts by bytes
        units[done * UNITS // total].append(source)
        done += os.path.getsize(source)
    entries = []
    for number, files in enumerate(units):
        path = os.path.join(sys.argv[2], "unit_%d.cpp" % number)
        with open(path, "w") as unit:
            for at, source in enumerate(files):  # each main has a name of its own
                line = '#include "%s"\n' % source
                unit.write("#define main main%d\n%s#undef main\n" % (at, line) if files is mains else line)
        command = "c++ -std=c++17 -fPIC -Wall -Wextra %s -c %s" % (" ".join(flags.values()), path)
        entries.append({"directory": sys.argv[2], "file": path, "command": command})
    with open(os.path.join(sys.argv[2], "compile_commands.json"), "w") as file:
        json.dump(entries, file)
    print("clang-tidy: %d files in %d units" % (len(sources), len(units)), file=sys.stderr)
    print("\n".join(entry["file"] for entry in entries))


if __name__ == "__main__":
    main()
