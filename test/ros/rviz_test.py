#!/usr/bin/env python3
"""rviz:=true shows the map, whatever the unit of the poses: demo.launch with the synthetic room in metres and in millimetres, on
a display of its own. Exit code 77: rviz or Xvfb is missing.

Usage: rviz_test.py FOLDER_OF_acmp_make_bag
"""
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rosbag
from PIL import ImageGrab

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from nodelet_session import end_all, start_master, wait_for  # noqa: E402  # pylint: disable=wrong-import-position,import-error

BACKGROUND, TOLERANCE = np.array([38, 40, 46]), 3  # of config/acmp_mapping.rviz; rounding by OpenGL
LEAST = 1 / 3  # of the view's pixels


def scaled(source, target, factor):
    """The bag with positions and points times factor, without tf."""
    with rosbag.Bag(source) as bag, rosbag.Bag(target, "w") as out:
        for topic, message, stamp in bag.read_messages():
            if topic == "/slam/pose":
                position = message.pose.position
                position.x, position.y, position.z = (factor * value for value in (position.x, position.y, position.z))
            elif topic == "/slam/sparse_points":
                values = np.frombuffer(message.data, "<f4").reshape(-1, message.point_step // 4).copy()
                values[:, [field.offset // 4 for field in message.fields if field.name in "xyz"]] *= factor
                message.data = values.tobytes()
            elif topic.startswith("/tf"):
                continue
            out.write(topic, message, stamp)


def share_of_map(display):
    """Of the pixels in the middle of rviz' 3D view, those that are not background; 0 where there is none, as before rviz has
    its window."""
    picture = np.asarray(ImageGrab.grab(xdisplay=display).convert("RGB")).astype(int)
    view = picture[200:700, 350:950]  # the panels are at both sides of it
    share = np.mean(np.abs(view - BACKGROUND).max(axis=2) > TOLERANCE)
    return share if share < 0.98 else 0.0


def main():
    for program in ("Xvfb", "rviz"):
        if not shutil.which(program, path=os.environ["PATH"] + ":/opt/ros/noetic/lib/rviz"):
            print(f"skipped: {program} is missing")
            return 77
    folder = tempfile.TemporaryDirectory()
    processes = []
    try:
        read, write = os.pipe()
        # Without -noreset it begins anew whenever its last client leaves, and refuses those that come meanwhile.
        processes.append(subprocess.Popen(["Xvfb", "-displayfd", str(write), "-noreset", "-screen", "0", "1440x920x24"],
                                          pass_fds=[write], stderr=subprocess.DEVNULL))
        display = ":" + os.read(read, 10).decode().strip()
        os.environ.update(DISPLAY=display, LIBGL_ALWAYS_SOFTWARE="1", QT_X11_NO_MITSHM="1", XDG_RUNTIME_DIR=folder.name)
        metres, millimetres = folder.name + "/m.bag", folder.name + "/mm.bag"
        subprocess.run([sys.argv[1] + "/acmp_make_bag", "--synthetic", metres, "--width", "160", "--height", "120"], check=True)
        scaled(metres, millimetres, 1000)
        for bag in (metres, millimetres):
            processes.append(start_master())
            launch = subprocess.Popen(["roslaunch", "acmp_mapping", "demo.launch", f"bag:={bag}", "device:=cpu",
                                       "preset:=online"])
            processes.append(launch)
            shares = []

            def shown():
                time.sleep(1)
                shares.append(share_of_map(display))
                return shares[-1] >= LEAST
            wait_for(shown, f"a picture of {bag} with a map in it", 300)
            print(f"{bag}: {100 * shares[-1]:.0f} % of the view is not background")
            launch.send_signal(signal.SIGINT)
            launch.wait()
            processes.pop()
            processes[-1].terminate()
    finally:
        end_all(processes)
        folder.cleanup()
    return 0


if __name__ == "__main__":
    sys.exit(main())
