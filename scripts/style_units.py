#!/usr/bin/python3
"""Makes what clang-tidy reads in check_style.sh: FOLDER/compile_commands.json and the units that it names, whose paths are
printed, the largest first, so that no processor is left with one at the end."""
import argparse
import json
import os
import re
import subprocess
import sys

UNITS = 2  # the same on every machine: what is in a unit decides whether names meet


def without_gcc_headers(command):
    """clang does not read GCC's precompiled ones."""
    return re.sub(r"-Winvalid-pch|-include \S*cmake_pch\S*", "", command)


def files_of(unit):
    """Of a unit of a unity build the files in it."""
    if not re.search(r"/Unity/unity_\d+(_cxx)?\.cxx$", unit):
        return [unit]
    with open(unit) as file:
        return [os.path.realpath(path) for path in re.findall(r'#include "(.*)"', file.read())]


def is_main(path):
    with open(path) as file:
        return re.search(r"^int main\(", file.read(), re.MULTILINE)


def write_unit(path, files):
    """Of several programs each main has a name of its own."""
    with open(path, "w") as unit:
        for number, file in enumerate(files):
            line = '#include "%s"\n' % file
            unit.write("#define main main%d\n%s#undef main\n" % (number, line) if is_main(file) else line)


def in_equal_parts(files, parts):
    """By bytes, in their order."""
    sizes = [os.path.getsize(file) for file in files]
    result, done = [[] for _ in range(parts)], 0
    for file, size in zip(files, sizes):
        result[done * parts // sum(sizes)].append(file)
        done += size
    return [part for part in result if part]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("compile_commands", metavar="COMPILE_COMMANDS")
    parser.add_argument("folder", metavar="FOLDER")
    parser.add_argument("--tests", action="store_true", help="the tests too")
    parser.add_argument("--one-by-one", action="store_true", help="each file alone")
    args = parser.parse_args()

    git = ["git", "ls-files", "*.cpp"]
    tracked = {os.path.realpath(path) for path in subprocess.check_output(git, text=True).split()}
    tests = os.path.realpath("test") + os.sep
    entries, sizes, sources, flags = [], {}, [], []

    def add(unit, files, entry):
        entries.append(dict(entry, file=unit))
        sizes[unit] = sum(map(os.path.getsize, files))

    with open(args.compile_commands) as file:
        compiled = json.load(file)
    for entry in compiled:
        unit = os.path.realpath(os.path.join(entry["directory"], entry["file"]))
        files = files_of(unit)
        chosen = [file for file in files if file in tracked and (args.tests or not file.startswith(tests))]
        command = without_gcc_headers(entry["command"])
        if args.one_by_one or (chosen and chosen[0].startswith(tests)):
            whole = chosen == files and not args.one_by_one
            for name, part in [(unit, files)] if whole else [(file, [file]) for file in chosen]:
                add(name, part, dict(entry, command=command.replace(entry["file"], name)))
        else:
            sources += [file for file in chosen if file not in sources]
            if chosen:
                # A macro has the first value that a target gives it.
                defined = {flag.split("=")[0] for flag in flags}
                flags += [flag for flag in re.findall(r"(?:-I|-isystem|-D) ?\S+", command) if flag.split("=")[0] not in defined]
    mains = [file for file in sources if is_main(file)]
    rest = sorted(set(sources) - set(mains))
    for number, part in enumerate(in_equal_parts(rest, UNITS) + [mains] if sources else []):
        name = os.path.join(args.folder, "unit_%d.cpp" % number)
        write_unit(name, part)
        command = "c++ -std=c++17 -fPIC -Wall -Wextra %s -c %s" % (" ".join(flags), name)
        add(name, part, {"directory": args.folder, "command": command})
    with open(os.path.join(args.folder, "compile_commands.json"), "w") as file:
        json.dump(entries, file)
    files = sum(len(files_of(unit)) for unit in sizes if not unit.startswith(args.folder)) + len(sources)
    print("clang-tidy: %d files in %d units" % (files, len(sizes)), file=sys.stderr)
    print("\n".join(sorted(sizes, key=sizes.get, reverse=True)))


if __name__ == "__main__":
    main()
