#!/bin/bash
# One build folder and one set of options for demo.sh and test.sh, and the time of each step. Usage: build_steps_test.sh SOURCE
set -u
cd "${1:?source folder}" || exit 1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failures=0
fail() {
  echo "FAILED: $*"
  failures=$((failures + 1))
}

# What each script gives to cmake to configure, with stand-ins for what it runs. The build fails, which ends both.
mkdir "$work/bin"
cat >"$work/bin/cmake" <<'STANDIN'
#!/bin/bash
if [ "$1" = --build ]; then exit 1; fi
echo "$*" >>"$CMAKE_CALLS"
echo "-- acmp_mapping: stand-in"
STANDIN
printf '#!/bin/bash\necho installed\n' >"$work/bin/dpkg-query"
chmod +x "$work/bin/"*
for script in demo test; do
  CMAKE_CALLS=$work/$script.calls ACMP_BUILD_DIR=$work/build PATH=$work/bin:$PATH DISPLAY='' \
    "scripts/$script.sh" >"$work/$script.log" 2>&1 && fail "$script.sh: the build failed, and it went on"
  grep -q "^-- packages: [0-9]* s$" "$work/$script.log" || fail "$script.sh: no time of a step: $(cat "$work/$script.log")"
done
[ "$(head -n 1 "$work/demo.calls")" = "$(head -n 1 "$work/test.calls")" ] ||
  fail "different options: $(cat "$work/demo.calls" "$work/test.calls")"
[ "$(wc -l <"$work/test.calls")" = 1 ] || fail "test.sh must not build without -Werror"
grep -q "ACMP_WARNINGS_AS_ERRORS=OFF" "$work/demo.calls" || fail "demo.sh must try without -Werror"

unset ACMP_BUILD_DIR
# shellcheck source=scripts/build_steps.sh
source scripts/build_steps.sh
# shellcheck disable=SC2154
[ "$build" = "$PWD/build" ] || fail "build folder $build"
SECONDS=0
lines=$(step one; SECONDS=7; step two; SECONDS=10; step)
[ "$lines" = $'== one\n-- one: 7 s\n== two\n-- two: 3 s\n-- in all: 10 s' ] || fail "$lines"
exit $((failures > 0))
