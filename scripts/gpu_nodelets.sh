#!/usr/bin/env bash
# Plays recordings to the nodelets on a machine with an NVIDIA GPU that has neither ROS nor this build:
#   scripts/gpu_nodelets.sh bundle FOLDER LAUNCH=BAG...   build, and gather it with Debian's ROS and the recordings in FOLDER
#   FOLDER/gpu_nodelets.sh run [OPTION...]                on the GPU machine, as root: options of gpu_nodelets.py, one table
# LAUNCH: a launch file of launch/frontends without its ending; its BAG has compressed images. FOLDER/root.tar.xz.* are parts
# of at most 24 MiB. Environment: ACMP_CUDA_ARCHITECTURES (default 90), ACMP_BUILD_DIR (build_gpu_nodelets); of run:
# RECORDINGS (LAUNCH of those to play, a shell pattern).
set -euo pipefail

# What rosmaster, roslaunch, rosbag play, a nodelet manager and their Python modules are in.
packages="python3.11-minimal libpython3.11-minimal libpython3.11-stdlib python3-rosbag python3-rosclean python3-rosgraph
  python3-rosgraph-msgs python3-roslaunch python3-roslib python3-roslz4 python3-rosmaster python3-rosmsg python3-rosnode
  python3-rosparam python3-rospkg python3-rospy python3-rosservice python3-rostopic python3-genmsg python3-genpy
  python3-geometry-msgs python3-nav-msgs python3-sensor-msgs python3-std-msgs python3-std-srvs python3-tf2-msgs
  python3-diagnostic-msgs python3-dynamic-reconfigure python3-nodelet python3-roscpp-msg python3-catkin python3-catkin-pkg
  python3-dateutil python3-distro python3-docutils python3-roman python3-defusedxml python3-netifaces python3-gnupg
  python3-pycryptodome python3-yaml python3-numpy python3-six python3-pyparsing python3-pkg-resources python3-lz4
  python3-distutils libimage-transport0d librosbag-storage4d libnodeletlib1d libtf2-ros1d
  libnodeletlib-tools rosout rospack-tools rosbash catkin netbase bash dash coreutils findutils sed grep mawk libc-bin
  iproute2 hostname"

unneeded='^/usr/(include|share/(doc|man|locale|lintian|bash-completion|common-lisp))/|\.a$'
unneeded+='|/(test|tests|idlelib|lib2to3|tkinter|ensurepip|SelfTest|pydoc_data|__pycache__|writers|f2py|cmake)/'

# copy: the files that are named on stdin, to the same place below $root, where /bin and others are links to those of /usr.
copy() {
  while read -r file; do [ ! -f "$file" ] || echo "${file#/}"; done | sort -u |
    tar -C / -ch --transform 's,^\(bin\|sbin\|lib\|lib64\)/,usr/&,' -T - | tar -C "$root" -x
}

elf_files() { find "$root" -type f \( -perm -u+x -o -name '*.so*' \) -exec sh -c 'head -c4 "$0" | grep -q ELF' {} \; -print; }

bundle() {
  local source folder build root part
  source=$(cd "$(dirname "$0")/.." && pwd)
  folder=$1
  build=${ACMP_BUILD_DIR:-$source/build_gpu_nodelets}
  root=$folder/root
  shift
  for part in "$@"; do  # before the build: on the GPU machine it would be too late
    if [ ! -f "$source/launch/frontends/${part%%=*}.launch" ]; then
      echo "LAUNCH=BAG \"$part\": LAUNCH must be one of $(cd "$source/launch/frontends" && printf '%s ' *.launch | sed 's/\.launch//g')" >&2
      exit 2
    elif [ "${part#*=}" = "$part" ] || [ ! -f "${part#*=}" ]; then
      echo "LAUNCH=BAG \"$part\": there is no such bag" >&2
      exit 2
    fi
  done
  cmake -S "$source" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DACMP_ROS=ON -DACMP_CUDA=ON \
    -DACMP_CUDA_ARCHITECTURES="${ACMP_CUDA_ARCHITECTURES:-90}" >/dev/null
  ninja -C "$build" acmp_mapping_nodelets acmp_mapping_generate_messages_py acmp_mapping_gencfg
  mkdir -p "$root"/{etc,proc,sys,dev,run,tmp,usr/{bin,sbin,lib,lib64},usr/local/nvidia,recordings,"$source","$build/devel/lib"}
  for part in bin sbin lib lib64; do ln -sfn usr/$part "$root/$part"; done
  # shellcheck disable=SC2086
  dpkg -L $packages | grep -vE "$unneeded" | copy
  # Descriptions, plug-ins and messages of all packages.
  find /usr/share/*/package.xml -printf '%h\n' | xargs -I{} find {} -type f -not -path '*/cmake/*' -size -200k | copy
  for part in python3:python3.11 sh:dash awk:mawk; do ln -sf "${part#*:}" "$root/usr/bin/${part%:*}"; done
  echo '127.0.0.1 localhost' >"$root/etc/hosts"
  (cd "$source" && cp -r launch config msg srv scripts package.xml nodelet_plugins.xml "$root$source/")
  cp -r "$build"/devel/{.catkin,share} "$root$build/devel/"
  cp -r "$build/devel/lib/"{libacmp_mapping_nodelets.so,python3} "$root$build/devel/lib/"
  for part in "$@"; do cp "${part#*=}" "$root/recordings/${part%%=*}.bag"; done
  # Shared libraries, and the names that glibc's had before, for which drivers ask.
  { elf_files | xargs ldd 2>/dev/null || true; } | awk '$3 ~ /^\// {print $3} $1 ~ /^\/.*[^:]$/ {print $1}' | copy
  printf '%s\n' /lib/x86_64-linux-gnu/lib{pthread,dl,rt,util,resolv,nss_files}.so.[012] | copy
  elf_files | xargs strip --strip-unneeded
  printf 'cd %q\nsource scripts/ros_environment.sh %q\n' "$source" "$build" >"$root/environment"
  cp "$0" "$folder/"
  tar -C "$folder" --owner=0 --group=0 -c root | xz --x86 --lzma2=preset=6,dict=128MiB | split -d -b 24M - "$folder/root.tar.xz."
  rm -r "$root"
  du -sh "$folder"
}

run() {
  local folder root driver part
  folder=$(cd "$(dirname "$0")" && pwd)
  root=$folder/root
  # Mounts are in a namespace of its own, and gone when it ends.
  if [ -z "${ACMP_NAMESPACE:-}" ]; then ACMP_NAMESPACE=1 exec unshare --mount --propagation private "$0" run "$@"; fi
  [ -d "$root" ] || cat "$folder"/root.tar.xz.* | xz -dc --memlimit-decompress=0 | tar -C "$folder" -x
  for part in proc sys dev; do mount --rbind /$part "$root/$part"; done
  for driver in $(ldconfig -p | awk '/libcuda\.so\.1|libnvidia-ml\.so\.1/ {print $NF}') /usr/local/nvidia/lib64/libcuda.so.1; do
    [ ! -e "$driver" ] || cp -Ln "$(dirname "$driver")"/lib{cuda,nvidia-ml,nvidia-ptxjitcompiler,nvidia-gpucomp}*.so* "$root/usr/local/nvidia/" 2>/dev/null || true
  done
  cp -L "$(command -v nvidia-smi)" "$root/usr/bin/" || echo "no nvidia-smi: no memory of the GPU in the table" >&2
  echo /usr/local/nvidia >"$root/etc/ld.so.conf"
  chroot "$root" ldconfig
  ip link set lo up 2>/dev/null || chroot "$root" ip link set lo up
  exec chroot "$root" env -i PATH=/usr/sbin:/usr/bin HOME=/tmp LANG=C.UTF-8 PYTHONUNBUFFERED=1 RECORDINGS="${RECORDINGS:-*}" \
    bash -c 'source /environment; exec python3 scripts/gpu_nodelets.py /recordings/$RECORDINGS.bag "$@"' - "$@"
}

case ${1:-} in
  bundle) [ $# -ge 3 ] || { sed -n '2,6p' "$0"; exit 2; }; shift; bundle "$@" ;;
  run) shift; run "$@" ;;
  *) sed -n '2,6p' "$0"; exit 2 ;;
esac
