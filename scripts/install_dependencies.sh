#!/bin/bash
# Installs the packages of scripts/debian_packages.txt that are missing, on Debian 11 to 13. Needs root or sudo only when
# one is missing. What it does for Ubuntu 20.04 (focal) has not been tried.
# Usage: scripts/install_dependencies.sh [--display] [--cuda]
#   --display   also what is needed to look at the demo (rviz)
#   --cuda      also Debian's CUDA toolkit, which is in its section non-free: where apt does not know that section, it is
#               added, with contrib and non-free-firmware. Not on Debian 11, whose CUDA 11.2 is too old. The driver is
#               yours to install.
set -euo pipefail
cd "$(dirname "$0")/.."

# packages SECTION: the packages of one section of the list, one a line; those before the first have the section "".
packages() {
  awk -v wanted="$1" '/^\[/ { section = substr($0, 2, length($0) - 2) }
                      !/^(\[|#|$)/ && section == wanted { gsub(/ /, "\n"); print }' scripts/debian_packages.txt
}

# is_in SECTION PACKAGE
is_in() { packages "$1" | grep -qx "$2"; }

# is_known PACKAGE: apt-cache show also succeeds for packages that others only name.
is_known() { [ -n "$(apt-cache madison "$1")" ]; }

release=$(. /etc/os-release && echo "$VERSION_CODENAME")
wanted="$(packages "") $(packages headers)"
for argument in "$@"; do
  case $argument-$release in
    --display-*) wanted+=" $(packages display)" ;;
    --cuda-bullseye | --cuda-focal)
      echo "--cuda: the CUDA toolkit of this release ($release) is older than 11.4: install NVIDIA's" >&2
      exit 2
      ;;
    --cuda-*) wanted+=" $(packages cuda)" ;;
    *)
      echo "usage: $0 [--display] [--cuda]" >&2
      exit 2
      ;;
  esac
done

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

# apt_get ARGUMENT...: as root. env inside sudo, which drops the environment.
apt_get() { "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get "$@"; }

echo "installing ${#missing[@]} Debian packages and what they depend on"
work=$(mktemp -d)
exec 3>&1 4>&2 >"$work/log" 2>&1 </dev/null
finish() {
  local code=$?
  if [ "$code" -ne 0 ]; then
    tail -n 30 "$work/log" >&4
    echo "packages could not be installed; their names are those of Debian 11 to 13" >&4
  fi
  "${as_root[@]}" rm -rf "$work"
  exit $((code != 0))
}
trap finish EXIT

apt_get update
here=() from_next=()
for package in "${missing[@]}"; do
  if is_in cuda "$package" && ! is_known "$package"; then
    # The section non-free from where the release comes from, and what the driver's library there needs.
    apt-get indextargets --format "deb \$(REPO_URI) $release contrib non-free non-free-firmware" "Created-By: Packages" \
      "Component: main" "Codename: $release" | sort -u |
      "${as_root[@]}" tee /etc/apt/sources.list.d/acmp_mapping_non_free.list
    apt_get update
  fi
  if is_in headers "$package" && ! is_known "$package"; then from_next+=("$package"); else here+=("$package"); fi
done
[ ${#here[@]} -eq 0 ] || apt_get install -y --no-install-recommends "${here[@]}"
if [ ${#from_next[@]} -gt 0 ]; then
  # Headers alone, for any processor, may come from the release after this one. The list of its packages is kept apart, so
  # that apt takes nothing else from it.
  case $release in
    bullseye) next=bookworm ;;
    focal) next=jammy ;;
    *) echo "this release ($release) does not have: ${from_next[*]}"; exit 1 ;;
  esac
  echo "from the release after this one: ${from_next[*]}"
  mkdir -p "$work/lists/partial"
  sed -n "s/^\(deb .*\) $release \(.*\)/\1 $next \2/p" /etc/apt/sources.list >"$work/sources.list"
  apart=(-o Dir::Etc::SourceList="$work/sources.list" -o Dir::Etc::SourceParts=- -o Dir::State::Lists="$work/lists"
         -o APT::Sandbox::User=root)
  apt_get "${apart[@]}" update
  (cd "$work" && apt_get "${apart[@]}" download "${from_next[@]}")
  "${as_root[@]}" dpkg -i "$work"/*.deb
fi
echo "done" >&3
