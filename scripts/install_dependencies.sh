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

release=$(. /etc/os-release && echo "$VERSION_CODENAME")
wanted=$(packages ""; packages headers)
for argument in "$@"; do
  case $argument in
    --display) wanted+=" $(packages display)" ;;
    --cuda)
      if [ "$release" = bullseye ] || [ "$release" = focal ]; then
        echo "--cuda: the CUDA toolkit of this release ($release) is older than 11.4: install NVIDIA's" >&2
        exit 2
      fi
      wanted+=" $(packages cuda)"
      ;;
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

# install_from_next_release PACKAGE...: packages without dependencies, from the release after this one. The list of its
# packages is kept apart, so that apt takes nothing else from it.
install_from_next_release() {
  local next folder apart
  case $release in
    bullseye) next=bookworm ;;
    focal) next=jammy ;;
    *)
      echo "this release ($release) does not have: $*"
      return 1
      ;;
  esac
  echo "from the release after this one: $*"
  folder=$(mktemp -d)
  mkdir -p "$folder/lists/partial"
  sed -n "s/^\(deb .*\) $release \(.*\)/\1 $next \2/p" /etc/apt/sources.list >"$folder/sources.list"
  apart=(-o Dir::Etc::SourceList="$folder/sources.list" -o Dir::Etc::SourceParts=- -o Dir::State::Lists="$folder/lists"
         -o APT::Sandbox::User=root)
  apt_get "${apart[@]}" update && (cd "$folder" && apt_get "${apart[@]}" download "$@") &&
    "${as_root[@]}" dpkg -i "$folder"/*.deb && "${as_root[@]}" rm -rf "$folder"
}

# add_non_free: the section non-free from where the release comes from, and what the driver's library there needs.
add_non_free() {
  apt-get indextargets --format "deb \$(REPO_URI) $release contrib non-free non-free-firmware" "Created-By: Packages" "Component: main" \
    "Codename: $release" | sort -u | "${as_root[@]}" tee /etc/apt/sources.list.d/acmp_mapping_non_free.list
  apt_get update
}

# is_known PACKAGE: apt-cache show also succeeds for packages that others only name.
is_known() { [ -n "$(apt-cache madison "$1")" ]; }

# install_missing: headers alone, for any processor, may come from the next release; what else this one lacks ends it.
install_missing() {
  local package here=() next=()
  apt_get update || return 1
  for package in "${missing[@]}"; do
    if packages cuda | grep -qx "$package" && ! is_known "$package"; then
      add_non_free || return 1
    fi
    if packages headers | grep -qx "$package" && ! is_known "$package"; then
      next+=("$package")
    else
      here+=("$package")
    fi
  done
  if [ ${#here[@]} -gt 0 ]; then apt_get install -y --no-install-recommends "${here[@]}" || return 1; fi
  if [ ${#next[@]} -gt 0 ]; then install_from_next_release "${next[@]}" || return 1; fi
}

echo "installing ${#missing[@]} Debian packages and what they depend on"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
if ! install_missing >"$log" 2>&1 </dev/null; then
  tail -n 30 "$log" >&2
  echo "packages could not be installed; their names are those of Debian 11 to 13" >&2
  exit 1
fi
echo "done"
