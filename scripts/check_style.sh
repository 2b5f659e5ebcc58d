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
  checks="--checks=clang-analyzer-*,-clang-analyzer-optin.cplusplus.VirtualCall,-clang-analyzer-optin.performance.Padding"
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
  # Only what this build compiles: without CUDA the files in cuda/ have no flags. The sources of all modules in
  # three units, as to read the headers takes longer than to check what includes them: a name without linkage means one
  # thing in all of src/. The tests in the units of a unity build. With --full each file alone, where a missing #include shows.
  commands=$(mktemp -d)
  trap 'rm -rf "$commands"' EXIT
  mapfile -t units < <(/usr/bin/python3 scripts/style_units.py "$build/compile_commands.json" "$commands" \
                         ${with_tests:+--tests} ${one_by_one:+--one-by-one})
  # tidy UNIT: what it says on stderr only where it fails, as that is mostly how many findings it does not show.
  tidy() {
    local log code=0
    log=$(mktemp -p "$commands")
    clang-tidy --quiet -p "$commands" "$checks" "$1" 2>"$log" || code=$?
    if [ "$code" -ne 0 ]; then
      echo "clang-tidy: $1: exit code $code"
      cat "$log"
    fi
    return "$code"
  }
  export -f tidy
  export commands checks
  printf '%s\0' "${units[@]}" | xargs -0 -P "$(nproc)" -I{} bash -c 'tidy {}' || failed=1
fi
exit $failed
