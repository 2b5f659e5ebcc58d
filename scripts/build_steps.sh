# Sourced by demo.sh and test.sh, from the repository's root: one build folder for both, so that nothing is compiled twice,
# and the time of each step.
# Environment: ACMP_BUILD_DIR (build), ACMP_CUDA (AUTO, ON or OFF).

build=${ACMP_BUILD_DIR:-$PWD/build}

# step NAME: says how long the step before took and that the next one begins. Without NAME: that it was the last one.
step_name=
step_start=0
step() {
  if [ -n "$step_name" ]; then echo "-- $step_name: $((SECONDS - step_start)) s"; fi
  step_name=${1:-}
  step_start=$SECONDS
  if [ -n "$step_name" ]; then echo "== $step_name"; else echo "-- in all: $SECONDS s"; fi
}

# configure [OPTION...]: the same options for both, as others would compile everything again.
configure() {
  mkdir -p "$build"
  cmake -S . -B "$build" -G Ninja -DACMP_CUDA="${ACMP_CUDA:-AUTO}" -DACMP_ROS=ON -DACMP_WARNINGS_AS_ERRORS=ON \
    -DACMP_BUILD_TESTS=ON -DCMAKE_BUILD_TYPE=Release "$@" >"$build/configure.log" 2>&1 ||
    { tail -n 30 "$build/configure.log"; return 1; }
  grep '^-- acmp_mapping:' "$build/configure.log"
}
