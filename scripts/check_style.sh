#!/bin/bash
# Format (clang-format) and mistakes (clang-tidy on every .cpp but the tests'; it cannot read .cu). Fails when one finds
# something.
# Usage: scripts/check_style.sh [--tests | --full] [BUILD_FOLDER]
#   BUILD_FOLDER  a configured build; without it only what needs none is checked
#   --tests       the tests too, which take as long as all else
#   --full        that, each file of a unity build alone, and the checks that take four times as long as all others: the
#                 analyser, parameters copied in vain, reserved names, C strings, assert and macros, and some that have
#                 never found anything
set -euo pipefail
cd "$(dirname "$0")/.."
checks=--checks=-bugprone-suspicious-include  # unity units include .cpp files
one_by_one=
with_tests=
if [ "${1:-}" = --tests ]; then
  with_tests=1
  shift
elif [ "${1:-}" = --full ]; then
  with_tests=1
  one_by_one=1
  checks=--checks=clang-analyzer-*,-clang-analyzer-optin.cplusplus.VirtualCall,-clang-analyzer-optin.performance.Padding
  checks+=,performance-unnecessary-value-param,bugprone-reserved-identifier,bugprone-assert-side-effect
  checks+=,bugprone-multiple-statement-macro,bugprone-not-null-terminated-result,bugprone-stringview-nullptr
  checks+=,bugprone-suspicious-semicolon,bugprone-suspicious-string-compare,bugprone-dangling-handle
  checks+=,bugprone-forward-declaration-namespace
  checks+=,bugprone-infinite-loop,bugprone-misplaced-widening-cast,bugprone-sizeof-expression
  checks+=,bugprone-undelegated-constructor,bugprone-unused-raii,modernize-use-nullptr
  checks+=,readability-container-size-empty
  shift
fi
build=${1:-}
export PYENV_VERSION=system

mapfile -t sources < <(git ls-files '*.h' '*.cpp' '*.cu' '*.cuh')
failed=0
clang-format --dry-run -Werror "${sources[@]}" || failed=1
echo "clang-format: ${#sources[@]} files"
if grep -n '#include <oneapi/' "${sources[@]}"; then
  echo "TBB 2020 (Debian 11, Ubuntu 20.04) has no oneapi/ headers: include <tbb/...>"
  failed=1
fi

if [ -n "$build" ]; then
  # Only what this build compiles: without CUDA the files in cuda/ have no flags. Without precompiled headers: clang
  # does not read GCC's. The units of a unity build as they are: headers are read once for many files. With --full each
  # file alone, where a missing #include shows.
  commands=$(mktemp -d)
  trap 'rm -rf "$commands"' EXIT
  mapfile -t units < <(/usr/bin/python3 - "$build/compile_commands.json" "$with_tests" "$one_by_one" "$commands" <<'PYTHON'
import json, os, re, subprocess, sys
commands, with_tests, one_by_one, folder = sys.argv[1:]
tracked = {os.path.realpath(path) for path in subprocess.check_output(["git", "ls-files", "*.cpp"], text=True).split()}
tests = os.path.realpath("test") + os.sep
files_of = {}  # by unit
entries = []
for entry in json.load(open(commands)):
    entry["command"] = re.sub(r"-Winvalid-pch|-include \S*cmake_pch\S*", "", entry["command"])
    unit = os.path.realpath(os.path.join(entry["directory"], entry["file"]))
    files = [unit]
    if re.search(r"/Unity/unity_\d+(_cxx)?\.cxx$", unit):
        files = [os.path.realpath(path) for path in re.findall(r'#include "(.*)"', open(unit).read())]
    chosen = [file for file in files if file in tracked and (with_tests or not file.startswith(tests))]
    units = {unit: files} if chosen == files and not one_by_one else {file: [file] for file in chosen}
    files_of.update(units)
    entries += [dict(entry, file=name, command=entry["command"].replace(entry["file"], name)) for name in units]
json.dump(entries, open(os.path.join(folder, "compile_commands.json"), "w"))
# Large ones first, so that no processor is left with one at the end.
sizes = {unit: sum(map(os.path.getsize, files)) for unit, files in files_of.items()}
print(f"clang-tidy: {sum(map(len, files_of.values()))} files in {len(sizes)} units", file=sys.stderr)
print("\n".join(sorted(sizes, key=sizes.get, reverse=True)))
PYTHON
)
  printf '%s\0' "${units[@]}" | xargs -0 -P "$(nproc)" -n 1 clang-tidy --quiet -p "$commands" $checks 2>/dev/null ||
    failed=1
fi
exit $failed
