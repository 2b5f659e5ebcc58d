#!/usr/bin/env bash
# Checks and times the CUDA backend on a machine with an NVIDIA GPU, which may be another one than it is built on:
#   scripts/gpu_check.sh bundle FOLDER [SCENE...]   build without ROS and gather programs, their libraries and scenes in FOLDER
#   FOLDER/gpu_check.sh run [RESULTS]               on the GPU machine: parity tests, sanitizer, quality, times
# SCENE: a folder with images/, cams/, pair.txt and ground truth in depth/ or gt_sparse/.
# Environment: ACMP_CUDA_ARCHITECTURES (default 90), STEPS (default "tests sanitizer quality times").
set -euo pipefail

programs="src/tools/acmp_reconstruct src/tools/acmp_evaluate src/tools/acmp_benchmark src/tools/acmp_make_scene
  test/patch_match/test_cuda_parity test/patch_match/test_patch_match_passes
  test/fill/test_fill test/backend/test_backend
  test/backend/test_several_gpus test/backend/test_texture_pool test/fusion/test_fusion
  test/pipeline/test_pipeline_synthetic test/pipeline/test_masks test/pipeline/test_prior_depth"

bundle() {
  local source build folder scene part
  source=$(cd "$(dirname "$0")/.." && pwd)
  build=$source/build_gpu
  folder=$(realpath -m "$1")  # programs are copied from another folder
  shift
  cmake -S "$source" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DACMP_ROS=OFF -DACMP_CUDA=ON \
    -DACMP_CUDA_ARCHITECTURES="${ACMP_CUDA_ARCHITECTURES:-90}" > /dev/null
  # shellcheck disable=SC2086
  ninja -C "$build" $(basename -a $programs)
  mkdir -p "$folder/bin" "$folder/lib" "$folder/scenes"
  cp "$0" "$folder/"
  # shellcheck disable=SC2086
  (cd "$build" && cp $programs "$folder/bin/")
  # Everything but glibc's own libraries and the driver's, which must be the GPU machine's.
  ldd "$folder"/bin/* | awk '$3 ~ /^\// && $1 !~ /^(lib(c|m|pthread|dl|rt|cuda)\.so|ld-linux)/ {print $3}' | sort -u |
    xargs cp -Lt "$folder/lib"
  for scene in "$@"; do
    mkdir -p "$folder/scenes/$(basename "$scene")"
    for part in images cams pair.txt cameras.txt depth gt_sparse; do
      [ ! -e "$scene/$part" ] || cp -r "$scene/$part" "$folder/scenes/$(basename "$scene")/"
    done
  done
  tar -C "$folder" --mode=u+w -cJf "$folder/programs.tar.xz" bin lib  # libraries are large and compress well
  rm -r "$folder/bin" "$folder/lib"
  du -sh "$folder"
}

check_sanitizer() {
  local tool scene=$1/tiny failed=0 masks
  acmp_make_scene "$scene" --width 80 --height 60 --keyframes 4 --moving-object > /dev/null || return 1
  for tool in memcheck racecheck initcheck; do
    for masks in "" "--masks=$scene/masks"; do  # kernels of their own
      echo "-- compute-sanitizer $tool $masks"
      # One image at a time: with four the tools did not come to an end within minutes.
      timeout 300 compute-sanitizer --tool "$tool" --error-exitcode 9 "$(command -v acmp_reconstruct)" "$scene" \
        "$1/tiny_$tool${masks:+_masked}" ${masks:+"$masks"} --device cuda --jobs-per-gpu 1 --quiet 2>&1 |
        tail -n 3 || failed=1
    done
  done
  return "$failed"
}

run() {
  local results=${1:-$(mktemp -d)} status=0
  root=$(cd "$(dirname "$0")" && pwd)
  mkdir -p "$results/programs"
  tar -C "$results/programs" -xJf "$root/programs.tar.xz"
  export PATH=$results/programs/bin:$PATH
  export LD_LIBRARY_PATH=$results/programs/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
  nvidia-smi --query-gpu=name,driver_version --format=csv,noheader
  for step in ${STEPS:-tests sanitizer quality times}; do
    echo "== $step"
    case $step in
      tests) for program in $programs; do
          case $program in test/*) echo "-- $(basename "$program")"; "$(basename "$program")" --gtest_brief=1 || status=1 ;; esac
        done ;;
      sanitizer) check_sanitizer "$results" || status=1 ;;
      quality)
        for scene in "$root"/scenes/*; do
          for preset in balanced online; do
            out=$results/quality/$(basename "$scene")/$preset
            truth=depth
            [ -d "$scene/depth" ] || truth=gt_sparse
            echo "-- $(basename "$scene") $preset"
            acmp_reconstruct "$scene" "$out" --device cuda --preset $preset --no-pictures --quiet || status=1
            rm -f "$out"/depth/*.png  # the maps as floats, not rounded to thousandths
            acmp_evaluate depth "$scene" "$out/depth" --gt "$truth" --quiet || status=1
          done
        done ;;
      times)
        for preset in balanced online; do
          acmp_benchmark --device cuda --preset $preset --sizes 320x240,640x480,3072x2048 --source-views 2,6,10,20 ||
            status=1
        done
        acmp_benchmark --device cuda --preset online --sizes 640x480 --source-views 7 --keyframes 1000 || status=1 ;;
      *) echo "unknown step $step" >&2; status=2 ;;
    esac
  done
  [ "$status" = 0 ] && echo "all steps passed" || echo "a step failed"
  return "$status"
}

case ${1:-} in
  bundle) [ $# -ge 2 ] || { sed -n '2,6p' "$0"; exit 2; }; shift; bundle "$@" ;;
  run) shift; run "$@" ;;
  *) sed -n '2,6p' "$0"; exit 2 ;;
esac
