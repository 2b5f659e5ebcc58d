# Sourced by demo.sh and test.sh, from the repository's root: one build folder for both, so that nothing is compiled twice,
# and the time of each step.
# Environment: ACMP_BUILD_DIR (build), ACMP_CUDA (AUTO, ON or OFF), ACMP_CUDA_ARCHITECTURES (see gpu_architectures).

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

# gpu_architectures: of this machine's GPUs, as code for all that the toolkit knows takes minutes more. Without one 75, the
# oldest: drivers translate its PTX for later ones.
gpu_architectures() {
  local found
  found=$(nvidia-smi --query-gpu=compute_cap --format=csv,noheader 2>/dev/null | tr -d . | sort -u | paste -sd ';') || true
  [[ $found =~ ^[0-9\;]+$ ]] || found=75
  echo "${ACMP_CUDA_ARCHITECTURES:-$found}"
}

# configure [OPTION...]: the same options for both, as others would compile everything again. A unity build: several files
# in one unit, so that the large headers of ROS, Eigen and OpenVDB are read once for them; half the time. The linker gold,
# where it is, takes 0.4 instead of 5 s for each program.
configure() {
  mkdir -p "$build"
  local linker=
  if command -v ld.gold >/dev/null; then linker=-fuse-ld=gold; fi
  cmake -S . -B "$build" -G Ninja -DACMP_CUDA="${ACMP_CUDA:-AUTO}" -DACMP_ROS=ON -DACMP_WARNINGS_AS_ERRORS=ON \
    -DACMP_BUILD_TESTS=ON -DCMAKE_BUILD_TYPE=Release -DCMAKE_UNITY_BUILD=ON -DCMAKE_UNITY_BUILD_BATCH_SIZE=0 \
    -DCMAKE_EXE_LINKER_FLAGS="$linker" -DCMAKE_SHARED_LINKER_FLAGS="$linker" \
    -DACMP_CUDA_ARCHITECTURES="$(gpu_architectures)" "$@" >"$build/configure.log" 2>&1 ||
    { tail -n 30 "$build/configure.log"; return 1; }
  grep '^-- acmp_mapping:' "$build/configure.log"
}

# configure_sanitized SANITIZERS: for the CPU, with clang's sanitizers, and its libFuzzer in the fuzz targets. One build for
# sanitizers.sh and fuzz.sh. At the first report the program ends. Without the Python module: the interpreter would have to
# be built so, too. With "thread" without libFuzzer, whose counters of branches all threads write.
configure_sanitized() {
  local clang fuzz=ON
  if [ "$1" = thread ]; then fuzz=OFF; fi
  clang=$(command -v clang++) || { echo "clang++ is missing: apt-get install clang" >&2; return 1; }
  ACMP_CUDA=OFF configure -DACMP_WARNINGS_AS_ERRORS=OFF -DACMP_FUZZ=$fuzz -DACMP_PYTHON=OFF -DCMAKE_CXX_COMPILER="$clang" \
    -DCMAKE_CXX_FLAGS="-fsanitize=$1 -fno-sanitize-recover=all -fno-omit-frame-pointer -D_GLIBCXX_ASSERTIONS \
-fsanitize-ignorelist=$PWD/scripts/sanitizer_suppressions/headers.txt" \
    -DCMAKE_CXX_FLAGS_RELEASE="-O1 -g1"
}
