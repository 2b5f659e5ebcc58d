#!/bin/bash
# Installs the Debian 12 packages of scripts/debian_packages.txt that are missing. Needs root or sudo only when one is.
# Usage: scripts/install_dependencies.sh [--display]     --display: also what is needed to look at the demo (rviz)
set -euo pipefail
cd "$(dirname "$0")/.."

list=scripts/debian_packages.txt
case "${1:-}" in
  "") wanted=$(sed -e '/^\[display\]/,$d' -e '/^#/d' -e '/^$/d' "$list") ;;
  --display) wanted=$(sed -e '/^\[/d' -e '/^#/d' -e '/^$/d' "$list") ;;
  *)
    echo "usage: $0 [--display]" >&2
    exit 2
    ;;
esac

missing=()
for package in $wanted; do
  [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null || true)" = installed ] || missing+=("$package")
done
if [ ${#missing[@]} -eq 0 ]; then
  echo "all Debian packages are installed"
  exit 0
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || { echo "not root and no sudo: install these packages: ${missing[*]}" >&2; exit 1; }
  as_root=(sudo)
fi
echo "installing ${#missing[@]} Debian packages and what they depend on"
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
trap 'rm -f "$log"' EXIT
# env inside sudo, which drops the environment.
if ! { "${as_root[@]}" apt-get update && "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
       apt-get install -y --no-install-recommends "${missing[@]}"; } >"$log" 2>&1 </dev/null; then
  tail -n 30 "$log" >&2
  echo "apt-get failed; the packages are those of Debian 12 (bookworm)" >&2
  exit 1
fi
echo "done"
