#!/bin/bash
# Runs the README's two commands on a bare Debian: in a new root made by debootstrap, with what is committed here. Fails when
# one does. Needs root, debootstrap and 6 GB.
# Usage: scripts/test_on.sh bullseye|bookworm|trixie [COMMAND...]
#   COMMAND   instead of scripts/demo.sh and scripts/test.sh, such as "scripts/install_dependencies.sh --cuda" before them
# Environment: ACMP_ROOTS, where the root is made (/var/tmp/acmp_roots); ACMP_CCACHE_DIR: a folder of ccache, which is then
# used; ACMP_PACKAGE: a file that is put there as /package.deb; DEBIAN_MIRROR, else debootstrap's own; and those of the two
# scripts.
set -euo pipefail
cd "$(dirname "$0")/.."
release=${1:?usage: $0 bullseye|bookworm|trixie [COMMAND...]}
shift
[ $# -gt 0 ] || set -- scripts/demo.sh scripts/test.sh
[ "$(id -u)" -eq 0 ] || { echo "$0 needs root, for debootstrap and chroot" >&2; exit 1; }
command -v debootstrap >/dev/null || { echo "$0 needs debootstrap: apt-get install debootstrap" >&2; exit 1; }
# Mounts are in a namespace of its own, and gone when it ends.
if [ -z "${ACMP_NAMESPACE:-}" ]; then ACMP_NAMESPACE=1 exec unshare --mount --propagation private "$0" "$release" "$@"; fi

root=${ACMP_ROOTS:-/var/tmp/acmp_roots}/$release
rm -rf "$root"
mkdir -p "$root"
echo "== debootstrap $release"
debootstrap --variant=minbase "$release" "$root" ${DEBIAN_MIRROR:+"$DEBIAN_MIRROR"} >"$root.log" 2>&1 ||
  { tail -n 20 "$root.log"; exit 1; }
cp --dereference /etc/resolv.conf "$root/etc/resolv.conf"
echo "127.0.0.1 localhost" >"$root/etc/hosts"  # debootstrap leaves it to whoever sets up the network
git init --quiet "$root/acmp_mapping"
git -C "$root/acmp_mapping" fetch --quiet "$PWD" HEAD
git -C "$root/acmp_mapping" reset --quiet --hard FETCH_HEAD

[ -z "${ACMP_PACKAGE:-}" ] || cp "$ACMP_PACKAGE" "$root/package.deb"

mount -t proc proc "$root/proc"
mount --rbind /dev "$root/dev"
environment=(HOME=/root LC_ALL=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin)
for name in ACMP_CUDA ACMP_SKIP_STYLE DEVICE; do [ -z "${!name:-}" ] || environment+=("$name=${!name}"); done
# inside COMMAND: runs it in the root, in the copy.
inside() { chroot "$root" /usr/bin/env -i "${environment[@]}" /bin/bash -c "cd /acmp_mapping && $1" </dev/null; }
if [ -n "${ACMP_CCACHE_DIR:-}" ]; then
  mkdir "$root/ccache"
  mount --bind "$ACMP_CCACHE_DIR" "$root/ccache"
  inside "apt-get update && apt-get install -y --no-install-recommends ccache" >"$root.log" 2>&1
  environment+=(CCACHE_DIR=/ccache "CCACHE_SLOPPINESS=pch_defines,time_macros" CMAKE_CXX_COMPILER_LAUNCHER=ccache)
fi

failed=0
for command in "$@"; do
  echo "==== $release: $command"
  inside "$command" || { failed=1; echo "==== $release: $command failed"; }
done
exit $failed
