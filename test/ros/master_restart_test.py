#!/usr/bin/env python3
"""The ROS master is killed while the mapper holds a map, and another one started: the map must be kept, found and
extended. Usage: master_restart_test.py SOURCE_FOLDER BUILD_FOLDER ACMP_MAKE_BAG"""
import os
import subprocess
import sys
import tempfile
from pathlib import Path

SOURCE, BUILD, MAKE_BAG = (Path(argument) for argument in sys.argv[1:4])
sys.path.insert(0, str(SOURCE / "scripts"))
import replay_report  # noqa: E402  pylint: disable=wrong-import-position

TOPICS = ["/camera/image_raw", "/camera/camera_info", "/slam/pose", "/slam/sparse_points"]
NAMES = ["image", "camera_info", "pose", "sparse_points"]


def call(service, *arguments):
    """The answer as text; empty while the service cannot be found."""
    result = subprocess.run(["rosservice", "call", service, *arguments], stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL, text=True, check=False)
    return result.stdout if result.returncode == 0 else ""


def points(folder):
    answer = call("/dense_mapper/save_map", f"{{path: {folder}/map.ply, format: 0, binary: true}}")
    return int(answer.split("points:")[1]) if "success: True" in answer else 0


def play(bag):
    subprocess.run(["rosbag", "play", "--quiet", "--wait-for-subscribers", "-r", "20", bag, "--topics", *TOPICS],
                   check=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, timeout=120)


def map_bag(bag, folder):
    """Plays the bag and returns the points of the map afterwards."""
    play(bag)
    replay_report.wait_for(lambda: "success: True" in call("/dense_mapper/flush") and points(folder) > 0, "a map")
    return points(folder)


def main():
    master = replay_report.start_master()
    mapper = None
    with tempfile.TemporaryDirectory() as folder:
        try:
            bag = f"{folder}/room.bag"
            subprocess.run([MAKE_BAG, "--synthetic", bag, "--width", "64", "--height", "48"], check=True)
            log = open(f"{folder}/log", "w")
            mapper = subprocess.Popen(
                [BUILD / "devel/lib/acmp_mapping/dense_mapper_node", "__name:=dense_mapper", "_device:=cpu",
                 "_overload:=block", "_geometric_passes:=1", *(f"{n}:={t}" for n, t in zip(NAMES, TOPICS))],
                stdout=log, stderr=subprocess.STDOUT)
            replay_report.wait_for(lambda: call("/dense_mapper/flush"), "the mapper")
            first = map_bag(bag, folder)
            # The watch reads what is registered every few seconds: it must have seen all of it once.
            replay_report.wait_for(lambda: "/dense_mapper/save_map" in subprocess.run(
                ["rosservice", "list"], stdout=subprocess.PIPE, text=True, check=True).stdout, "the services")
            master.kill()
            master.wait()
            replay_report.wait_for(lambda: "cannot be reached" in Path(folder, "log").read_text(), "the warning")
            master = replay_report.start_master(int(os.environ["ROS_MASTER_URI"].rsplit(":", 1)[1]))
            replay_report.wait_for(lambda: "registered again" in Path(folder, "log").read_text(), "registration")
            kept = points(folder)
            again = map_bag(bag, folder)
            print(f"{first} points, {kept} after the restart, {again} after the bag was played again")
            failures = []
            if kept != first:
                failures.append("the map was not kept")
            # The same images again are keyframes of their own, matched in another order at the window's ends.
            if again < kept:
                failures.append("points were lost")
            if "time jumped back" not in Path(folder, "log").read_text():
                failures.append("the second run's images did not arrive")
            if mapper.poll() is not None:
                failures.append("the mapper has died")
            sys.exit("; ".join(failures) or 0)
        finally:
            if mapper:
                mapper.terminate()
                mapper.wait(60)
            master.terminate()
            master.wait()


if __name__ == "__main__":
    main()
