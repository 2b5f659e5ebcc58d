#!/bin/bash
# Format (clang-format) and mistakes (clang-tidy on every .cpp but the tests'; it cannot read .cu). Fails when one finds
# something.
# Usage: scripts/check_style.sh [--tests | --full] [BUILD_FOLDER]
#   BUILD_FOLDER  a configured build; without it only what needs none is checked
#   --tests       the tests too, which take as long as all else
#   --full        that, and the checks that take four times as long as all others: the analyser, parameters copied in vain,
#                 reserved names, C strings, assert and macros, and some that have never found anything
set -euo pipefail
cd "$(dirname "$0")/.."
more_checks=
with_tests=
if [ "${1:-}" = --tests ]; then
  with_tests=1
  shift
elif [ "${1:-}" = --full ]; then
  with_tests=1
  more_checks=--checks=clang-analyzer-*,-clang-analyzer-optin.cplusplus.VirtualCall,-clang-analyzer-optin.performance.Padding
  more_checks+=,performance-unnecessary-value-param,bugprone-reserved-identifier,bugprone-assert-side-effect
  more_checks+=,bugprone-multiple-statement-macro,bugprone-not-null-terminated-result,bugprone-stringview-nullptr
  more_checks+=,bugprone-suspicious-semicolon,bugprone-suspicious-string-compare,bugprone-dangling-handle
  more_checks+=,bugprone-infinite-loop,bugprone-misplaced-widening-cast,bugprone-sizeof-expression
  more_checks+=,bugprone-undelegated-constructor,bugprone-unused-raii,modernize-use-nullptr
  more_checks+=,readability-container-size-empty
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
  # Only what this build compiles: without CUDA the files in cuda/ have no flags. Without precompiled headers: clang does
  # not read GCC's.
  commands=$(mktemp -d)
  trap 'rm -rf "$commands"' EXIT
  mapfile -t units < <(/usr/bin/python3 - "$build/compile_commands.json" "$with_tests" "$commands" <<'PYTHON'
import json, os, re, subprocess, sys
entries = json.load(open(sys.argv[1]))
for entry in entries:
    entry["command"] = re.sub(r"-Winvalid-pch|-include \S*cmake_pch\S*", "", entry["command"])
json.dump(entries, open(os.path.join(sys.argv[3], "compile_commands.json"), "w"))
tracked = {os.path.realpath(path) for path in subprocess.check_output(["git", "ls-files", "*.cpp"], text=True).split()}
tests = os.path.realpath("test") + os.sep
units = {os.path.realpath(os.path.join(entry["directory"], entry["file"])) for entry in entries}
# Large files first, so that no processor is left with one at the end.
chosen = {unit for unit in tracked & units if sys.argv[2] or not unit.startswith(tests)}
print("\n".join(sorted(chosen, key=os.path.getsize, reverse=True)))
PYTHON
)
  printf '%s\0' "${units[@]}" | xargs -0 -P "$(nproc)" -n 4 clang-tidy --quiet -p "$commands" $more_checks 2>/dev/null ||
    failed=1
  echo "clang-tidy: ${#units[@]} files"
fi
exit $failed
