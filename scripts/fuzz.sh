#!/bin/bash
# Builds the fuzz targets of test/fuzz with clang's libFuzzer, AddressSanitizer and UndefinedBehaviorSanitizer and runs each.
# Ends with a table: target, runs, findings (crash, timeout above 10 s, oom above 2 GB, leak). Fails when there are any. They
# lie in BUILD/findings; copy them to test/fuzz/corpus/NAME, so that the tests go on trying them.
# Usage: scripts/fuzz.sh [SECONDS [NAME...]]     SECONDS: of each target (60); NAME: of ACMP_FUZZ_TARGET(NAME) in test/fuzz (all)
# Environment: ACMP_SANITIZE_BUILD_DIR (build_sanitize, that of sanitizers.sh). Needs what test.sh needs, and clang.
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-60}
[[ $seconds =~ ^[1-9][0-9]*$ ]] || { echo "usage: $0 [SECONDS [NAME...]]" >&2; exit 2; }
shift || true
export ACMP_BUILD_DIR=${ACMP_SANITIZE_BUILD_DIR:-$PWD/build_sanitize} PYENV_VERSION=system
# shellcheck source=scripts/build_steps.sh
source scripts/build_steps.sh
configure_sanitized address,undefined,float-cast-overflow
cmake --build "$build" --parallel "$(nproc)" --target acmp_fuzz_targets
python3 test/fuzz/make_seeds.py "$build/seeds"
export build seconds
names=("$@")
if [ ${#names[@]} -eq 0 ]; then
  for path in "$build"/devel/lib/acmp_mapping/fuzz_*; do names+=("${path##*/fuzz_}"); done
fi

export findings=$build/findings
# run NAME: one target; its log and what it finds are kept.
run() {
  mkdir -p "$findings/$1" "$build/corpus/$1"
  rm -f "$findings/$1"/*
  TMPDIR=$(mktemp -d -p "$([ -w /dev/shm ] && echo /dev/shm || echo /tmp)")
  export TMPDIR
  "$build/devel/lib/acmp_mapping/fuzz_$1" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -print_final_stats=1 \
    -artifact_prefix="$findings/$1/" -verbosity=0 "$build/corpus/$1" "$build/seeds/$1" >"$findings/$1.log" 2>&1 || true
  rm -rf "$TMPDIR"
}
export -f run
export ASAN_OPTIONS=allocator_may_return_null=1 UBSAN_OPTIONS=print_stacktrace=1
printf '%s\0' "${names[@]}" | xargs -0 -P "$(nproc)" -I{} bash -c 'run {}'

failed=0
printf '\n%-18s %10s   %s\n' target runs findings
for name in "${names[@]}"; do
  runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$findings/$name.log" | tail -n 1)
  found=$(cd "$findings/$name" && echo *-*)
  printf '%-18s %10s   %s\n' "$name" "${runs:-none}" "${found#\*-\*}"
  if [ "$found" != '*-*' ] || [ -z "$runs" ]; then failed=1; fi
done
exit $failed
