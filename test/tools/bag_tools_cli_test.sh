#!/bin/bash
# Exit codes and messages of the bag tools' command lines. Usage: bag_tools_cli_test.sh FOLDER_OF_THE_PROGRAMS
set -u
# shellcheck source=test/tools/expect.sh
source "$(dirname "$0")/expect.sh"

small=(--synthetic --width 48 --height 36 --keyframes 4)
# A file size limit stands in for a full disk: writing fails half way, with the signal for it ignored.
limited() { (ulimit -f 10; trap '' XFSZ; "$@"); }

expect 0 "Usage: acmp_make_bag" "$bin/acmp_make_bag" --help
expect 0 "4 images" "$bin/acmp_make_bag" "${small[@]}" a.bag
expect 0 "4 images" "$bin/acmp_make_bag" "${small[@]}" b.bag --ground-truth truth
cmp a.bag b.bag || fail "two runs differ"
[ -s truth/depth/000003.png ] || fail "no ground truth"
expect 2 "not an empty folder" "$bin/acmp_make_bag" "${small[@]}" other.bag --ground-truth truth
expect 0 "usable: 0 errors" "$bin/acmp_check_bag" a.bag
expect 0 "pose_source:=tf world_frame:=world" "$bin/acmp_check_bag" a.bag --pose /tf

expect 2 "give SCENE and OUT.bag" "$bin/acmp_make_bag" out.bag
expect 2 "--synthetic takes no SCENE" "$bin/acmp_make_bag" --synthetic scene out.bag
expect 2 "required" "$bin/acmp_make_bag"
expect 0 "4 images" "$bin/acmp_make_bag" "${small[@]}" --scene hard hard.bag
cmp -s a.bag hard.bag && fail "--scene hard is the room"
expect 0 "4 images" "$bin/acmp_make_bag" "${small[@]}" --stereo-baseline 0.11 --standing --moving-object pair.bag
expect 2 "no baseline" "$bin/acmp_check_bag" pair.bag
expect 0 "stereo:=true source_image:=/camera_right/image_raw source_camera_info:=/camera_right/camera_info" \
  "$bin/acmp_check_bag" pair.bag --source-image /camera_right/image_raw
expect 2 "stereo baseline = 9" "$bin/acmp_make_bag" "${small[@]}" --stereo-baseline 9 out.bag
expect 2 "--standing requires --synthetic" "$bin/acmp_make_bag" --standing . out.bag
expect 2 "--scene requires --synthetic" "$bin/acmp_make_bag" --scene hard . out.bag
expect 2 "must be one of room, hard" "$bin/acmp_make_bag" --synthetic --scene kitchen out.bag
expect 2 "keyframes" "$bin/acmp_make_bag" --synthetic --keyframes 1 out.bag
expect 2 "rate = 0" "$bin/acmp_make_bag" "${small[@]}" --rate 0 out.bag
expect 2 "must be auto, colmap or mvsnet" "$bin/acmp_make_bag" --format ply . out.bag
expect 2 "missing" "$bin/acmp_make_bag" missing out.bag
expect 2 "is a folder" "$bin/acmp_make_bag" "${small[@]}" .
expect 2 "there is no folder" "$bin/acmp_make_bag" "${small[@]}" missing/out.bag
expect 1 "cannot write" limited "$bin/acmp_make_bag" "${small[@]}" out.bag
expect 1 'cannot write "out.bag"' bash -c 'ulimit -f 1; trap "" XFSZ; "$@"' bash "$bin/acmp_make_bag" "${small[@]}" out.bag
[ ! -e out.bag ] && [ ! -e out.bag.acmp.partial ] || fail "a failed run left files"

head -c 5000 a.bag >cut.bag
expect 1 "cannot write to the standard output" eval '"$bin/acmp_check_bag" a.bag 2>&1 >/dev/full'
expect 1 "cannot write to the standard output" eval '"$bin/acmp_check_bag" --help 2>&1 >/dev/full'
for node in dense_mapper_node map_server_node; do
  for kilobytes in 300000 600000; do  # else libraries of others abort, or wait for ever
    expect 1 "address space" timeout 60 bash -c "ulimit -c 0 -v $kilobytes; exec $bin/$node"
  done
done
expect 2 "truncated" "$bin/acmp_check_bag" cut.bag
expect 2 "no such file" "$bin/acmp_check_bag" missing.bag
mkfifo pipe.bag
expect 2 "pipe or socket" timeout 60 "$bin/acmp_check_bag" pipe.bag
ln -s loop.bag loop.bag
expect 2 "symbolic links" "$bin/acmp_check_bag" loop.bag
printf 'SQLite format 3\0more' > ros2.db3
printf '\x89MCAP0\r\nmore' > ros2.mcap
mkdir ros2_folder
touch ros2_folder/metadata.yaml
for recording in ros2.db3 ros2.mcap ros2_folder; do
  expect 2 "is a recording of ROS 2" "$bin/acmp_check_bag" "$recording"
done
expect 2 "not in the bag" "$bin/acmp_check_bag" a.bag --image /nowhere
expect 2 "--pose-is" "$bin/acmp_check_bag" a.bag --pose-is upside_down

echo "$failures failures"
[ "$failures" -eq 0 ]
