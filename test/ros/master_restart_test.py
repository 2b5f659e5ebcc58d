#!/usr/bin/env python3
"""The ROS master is killed while mapper and map are loaded, and another one started: the map must be kept, found and
extended. Usage: master_restart_test.py SOURCE_FOLDER BUILD_FOLDER ACMP_MAKE_BAG"""
import json
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


def load(name, nodelet):
    request = {"name": name, "type": f"acmp_mapping/{nodelet}", "remap_source_args": [f"/{n}" for n in NAMES],
               "remap_target_args": TOPICS}
    replay_report.wait_for(lambda: "success: True" in call("/manager/load_nodelet", json.dumps(request)), name)


def points(folder):
    answer = call("/map_server/save_map", f"{{path: {folder}/map.ply, format: 0, binary: true}}")
    return int(answer.split("points:")[1].split()[0]) if "success: True" in answer else 0


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
    manager = None
    with tempfile.TemporaryDirectory() as folder:
        try:
            bag = f"{folder}/room.bag"
            subprocess.run([MAKE_BAG, "--synthetic", bag, "--width", "64", "--height", "48"], check=True)
            log = open(f"{folder}/log", "w")
            manager = subprocess.Popen(["rosrun", "nodelet", "nodelet", "manager", "__name:=manager"], stdout=log,
                                       stderr=subprocess.STDOUT)
            for name, value in (("device", "cpu"), ("overload", "block"), ("preset", "online")):
                subprocess.run(["rosparam", "set", f"/dense_mapper/{name}", value], check=True)
            subprocess.run(["rosparam", "set", "/map_server/save_folder", folder], check=True)
            load("/map_server", "MapServerNodelet")
            load("/dense_mapper", "DenseMapperNodelet")
            replay_report.wait_for(lambda: call("/dense_mapper/flush"), "the mapper")
            first = map_bag(bag, folder)
            # The watch reads what is registered every few seconds: it must have seen all of it once.
            replay_report.wait_for(lambda: "/map_server/save_map" in subprocess.run(
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
            if manager.poll() is not None:
                failures.append("the nodelets' manager has died")
            sys.exit("; ".join(failures) or 0)
        finally:
            if manager:
                manager.terminate()
                manager.wait(60)
            master.terminate()
            master.wait()


if __name__ == "__main__":
    main()
