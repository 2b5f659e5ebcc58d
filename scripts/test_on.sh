#!/bin/bash
# Runs the README's two commands, scripts/demo.sh and scripts/test.sh, on a bare Debian: in a new root made by debootstrap,
# with what is committed here. Ends with a line that says how each ended. Needs root, debootstrap and 6 GB.
# Usage: scripts/test_on.sh [--cuda] bullseye|bookworm|trixie
#   --cuda   before that Debian's CUDA toolkit (scripts/install_dependencies.sh --cuda), which takes 5 GB more
# Environment: ACMP_ROOTS, where roots are made (/var/tmp/acmp_roots); ACMP_KEEP_ROOT=1: goes on in the root of the run
# before; ACMP_CCACHE_DIR: a folder of ccache, which is then used; DEBIAN_MIRROR, else debootstrap's own; and those of
# the two scripts.
set -euo pipefail
cd "$(dirname "$0")/.."
commands=(scripts/demo.sh scripts/test.sh)
if [ "${1:-}" = --cuda ]; then
  commands=("scripts/install_dependencies.sh --cuda" "${commands[@]}")
  shift
fi
release=${1:-}
case $release in
  bullseye | bookworm | trixie) ;;
  *)
    echo "usage: $0 [--cuda] bullseye|bookworm|trixie" >&2
    exit 2
    ;;
esac
[ "$(id -u)" -eq 0 ] || { echo "$0 needs root, for debootstrap and chroot" >&2; exit 1; }
command -v debootstrap >/dev/null || { echo "$0 needs debootstrap: apt-get install debootstrap" >&2; exit 1; }

root=${ACMP_ROOTS:-/var/tmp/acmp_roots}/$release
mounts=()
unmount() {
  local i
  for ((i = ${#mounts[@]} - 1; i >= 0; --i)); do umount "${mounts[i]}" || umount --lazy "${mounts[i]}"; done
  mounts=()
}
trap unmount EXIT
# bind FOLDER FOLDER_IN_ROOT
bind() {
  mkdir -p "$root$2"
  mount --bind "$1" "$root$2"
  mounts+=("$root$2")
}

if [ "${ACMP_KEEP_ROOT:-0}" != 1 ] || [ ! -e "$root/acmp_root_is_whole" ]; then
  if grep -q " $root/" /proc/mounts; then echo "$root has mounts: another run?" >&2; exit 1; fi
  rm -rf "$root"
  mkdir -p "$root"
  echo "== debootstrap $release"
  debootstrap --variant=minbase "$release" "$root" ${DEBIAN_MIRROR:+"$DEBIAN_MIRROR"} >"$root.log" 2>&1 ||
    { tail -n 20 "$root.log"; exit 1; }
  touch "$root/acmp_root_is_whole"
fi
mount -t proc proc "$root/proc"
mounts+=("$root/proc")
bind /dev /dev
bind /dev/shm /dev/shm
cp --dereference /etc/resolv.conf "$root/etc/resolv.conf"
echo "127.0.0.1 localhost" >"$root/etc/hosts"  # debootstrap leaves it to whoever sets up the network
git init --quiet "$root/acmp_mapping"
git -C "$root/acmp_mapping" fetch --quiet "$PWD" HEAD
git -C "$root/acmp_mapping" reset --quiet --hard FETCH_HEAD

environment=(HOME=/root LC_ALL=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin)
for name in ACMP_CUDA ACMP_SKIP_STYLE DEVICE; do [ -z "${!name:-}" ] || environment+=("$name=${!name}"); done
# inside COMMAND: runs it in the root, in the copy.
inside() { chroot "$root" /usr/bin/env -i "${environment[@]}" /bin/bash -c "cd /acmp_mapping && $1" </dev/null; }

if [ -n "${ACMP_CCACHE_DIR:-}" ]; then
  bind "$ACMP_CCACHE_DIR" /ccache
  inside "apt-get update && apt-get install -y --no-install-recommends ccache" >"$root.log" 2>&1
  environment+=(CCACHE_DIR=/ccache "CCACHE_SLOPPINESS=pch_defines,time_macros" CMAKE_CXX_COMPILER_LAUNCHER=ccache)
fi

failed=0
ends=""
for command in "${commands[@]}"; do
  echo "==== $release: $command"
  code=0
  inside "$command" || code=$?
  ends+="${ends:+, }$command with $code"
  [ "$code" -eq 0 ] || failed=1
done
echo "$release ended $ends"
exit $failed
