#!/usr/bin/env python3
"""See faults.sh. Usage: faults.py BUILD RUNS SECONDS"""
import math
import os
import random
import re
import subprocess
import sys
import tempfile
import threading
import time
from io import BytesIO
from pathlib import Path

import rosbag
import rospy
from acmp_mapping.msg import KeyframePoints
from nav_msgs.msg import Path as RosPath
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Image

import replay_report
from nodelet_session import TOPICS, Session, call, make_bag, save_map, save_session

PLY_BYTES_PER_POINT = 6 * 4 + 3 + 4
CHOICE = random.Random(1)


class Fault(Exception):
    """What must not be."""


def expect(condition, text):
    if not condition:
        raise Fault(text)


def points_of_whole_ply(path):
    content = path.read_bytes()
    head = content.index(b"end_header\n") + len(b"end_header\n")
    points = int(re.search(rb"element vertex (\d+)", content[:head]).group(1))
    expect(len(content) == head + points * PLY_BYTES_PER_POINT, f"{path.name} is broken: {len(content)} bytes")
    return points


def temporary_files(folder):
    return [path for path in Path(folder).iterdir() if ".partial" in path.name]


def keyframes_of_whole_session(path):
    with rosbag.Bag(str(path)) as bag:
        expected = next(bag.read_messages(["/session_keyframes"])).message.data
        keyframes = sum(1 for _ in bag.read_messages(["/keyframe_points"]))
        expect(keyframes == expected == bag.get_message_count("/depth/image_rect"), f"{path.name} is broken")


def kill_in_save(build, runs, _seconds, name="map.ply", save=save_map, check=points_of_whole_ply):
    """The file is the one of before or the new one, and what is left over is used by the next save."""
    caught = 0
    with tempfile.TemporaryDirectory() as folder:
        bag, path = make_bag(build, f"{folder}/room.bag"), Path(folder, name)
        for _ in range(runs):
            with Session(folder) as session:
                session.map_bag(bag)
                save(path)
                expect(not temporary_files(folder), "temporary files are left after a save")
                saver = threading.Thread(target=save, args=(path,))
                saver.start()
                while not temporary_files(folder) and saver.is_alive():
                    time.sleep(1e-4)
                time.sleep(CHOICE.uniform(0, 2e-3))
                session.manager.kill()
                saver.join()
                caught += bool(temporary_files(folder))
                check(path)
    return f"{name} whole after each; {caught} times a temporary file was left, used again by the next save"


def kill_in_save_session(build, runs, seconds):
    return kill_in_save(build, runs, seconds, "session.bag", save_session, keyframes_of_whole_session)


def kill_in_reconstruction(build, runs, _seconds):
    """The run that goes on gives the bytes of an undisturbed one."""
    programs = build / "devel/lib/acmp_mapping"
    with tempfile.TemporaryDirectory() as folder:
        scene = f"{folder}/scene"
        subprocess.run([programs / "acmp_make_scene", scene, "--width", "160", "--height", "120", "--keyframes", "8"],
                       check=True, stdout=subprocess.DEVNULL)

        def start(name):
            return subprocess.Popen([programs / "acmp_reconstruct", scene, f"{folder}/{name}", "--device", "cpu"],
                                    stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        begin = time.monotonic()
        expect(start("whole").wait() == 0, "the undisturbed run failed")
        whole_s = time.monotonic() - begin
        for run in range(runs):
            process = start(run)
            time.sleep(CHOICE.uniform(0.05, 0.95) * whole_s)
            process.kill()
            process.wait()
            process = start(run)
            expect(process.wait() == 0, f"the run that goes on failed: {process.stderr.read()}")
            same = Path(folder, "whole/fused.ply").read_bytes() == Path(folder, f"{run}/fused.ply").read_bytes()
            expect(same, "the run that went on has another cloud")
    return "the clouds of the runs that went on are the same bytes"


def full_disk(build, _runs, _seconds):
    """save_map says so and leaves the earlier file, the manager lives; with space again it saves."""
    if os.geteuid() != 0:
        return "skipped: a small file system needs root"
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "none", folder], check=True)
        try:
            with tempfile.TemporaryDirectory() as elsewhere, Session(folder) as session:
                points = session.map_bag(make_bag(build, f"{elsewhere}/room.bag"))
                filler, path = Path(folder, "filler"), Path(folder, "map.ply")
                before = path.read_bytes()
                try:
                    filler.write_bytes(bytes(16 << 20))
                except OSError:
                    pass
                saved, answer = save_map(path)
                expect(saved == 0 and "No space left on device" in answer, f"save_map on a full disk: {answer}")
                expect(path.read_bytes() == before and not temporary_files(folder), "save_map left its traces")
                expect(session.alive(), "the manager has died")
                tool = subprocess.run([build / "devel/lib/acmp_mapping/acmp_make_scene", f"{folder}/scene"], check=False,
                                      stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
                expect(tool.returncode == 1 and "No space left" in tool.stderr, f"acmp_make_scene: {tool.stderr}")
                filler.unlink()
                expect(save_map(path)[0] == points, "save_map with space again")
        finally:
            subprocess.run(["umount", "--lazy", folder], check=True)
    return "save_map and acmp_make_scene: No space left on device; earlier map kept, saved again afterwards"


def master_restart(build, _runs, _seconds):
    test = subprocess.run([sys.executable, "test/ros/master_restart_test.py", ".", str(build)], check=False,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    last = (test.stdout.strip().splitlines() or ["nothing"])[-1]
    expect(test.returncode == 0, last)
    return last


def wild_number(kind, value, choice):
    if kind in ("float32", "float64"):
        return choice.choice([math.nan, math.inf, -math.inf, 0.0, -1.0, 1e30, 1e-30, -value])
    bits, signed = int(re.search(r"\d+$", kind).group()), not kind.startswith("u")
    top = (1 << (bits - signed)) - 1
    return choice.choice([0, 1, top, top - 3, top // 2 + 1, -top - 1 if signed else top // 3])


def make_wild(message, share, choice):
    """Changes a share of the message's values, at any depth, to others of their types."""
    for name, kind in zip(message.__slots__, message._slot_types):  # pylint: disable=protected-access
        value = getattr(message, name)
        if hasattr(value, "_slot_types") and kind != "time":
            make_wild(value, share, choice)
        elif isinstance(value, list) and value and hasattr(value[0], "_slot_types"):
            for element in value:
                make_wild(element, share, choice)
        elif choice.random() > share:
            continue
        elif kind == "time":
            value.secs, value.nsecs = choice.choice([0, 1, 2**31, 2**32 - 1]), choice.choice([0, 10**9 - 1, 2**32 - 1])
        elif kind == "string":
            setattr(message, name, choice.choice(["", "/", "x" * 10000, "\n", value[:-1]]))
        elif isinstance(value, bytes):
            setattr(message, name, choice.choice([b"", value[:-1], value + b"\0", bytes(len(value)), choice.randbytes(len(value))]))
        elif isinstance(value, (list, tuple)):
            number = kind.split("[")[0]
            setattr(message, name, [wild_number(number, v, choice) if choice.random() < 0.2 else v for v in value])
        elif kind != "bool":
            setattr(message, name, wild_number(kind, value, choice))


def made_wild(message, share, choice):
    """A changed copy. choice: a random.Random"""
    buffer = BytesIO()
    message.serialize(buffer)
    copy = type(message)().deserialize(buffer.getvalue())
    make_wild(copy, share, choice)
    return copy


def wild_messages(build, _runs, seconds):
    """The manager lives, takes no memory for what a message claims, and maps what follows."""
    with tempfile.TemporaryDirectory() as folder, Session(folder) as session:
        bag, points = make_bag(build, f"{folder}/room.bag"), []
        rospy.init_node("wild", disable_signals=True)
        rospy.Subscriber("/keyframe_points", KeyframePoints, points.append, queue_size=100)
        before = session.map_bag(bag)
        replay_report.wait_for(lambda: points, "keyframe_points")
        good = [(topic, message) for topic, message, _ in rosbag.Bag(bag).read_messages(topics=list(TOPICS.values()))]
        image = next(message for topic, message in good if topic == TOPICS["image"])
        poses = [message for topic, message in good if topic == TOPICS["pose"]]
        mask = Image(image.header, image.height, image.width, "mono8", 0, image.width, bytes(image.height * image.width))
        depth = Image(image.header, image.height, image.width, "16UC1", 0, 2 * image.width, bytes(2 * image.height * image.width))
        good += [("/prior_depth", depth)]
        good += [("/keyframe_points", points[0]), ("/mask", mask), ("/optimized_path", RosPath(PoseStamped().header, poses))]
        publishers = {}
        for topic, message in good:
            if topic not in publishers:
                publishers[topic] = rospy.Publisher(topic, type(message), queue_size=10)
        time.sleep(2)
        sent, end = 0, time.monotonic() + seconds
        while time.monotonic() < end and session.alive():
            topic, message = CHOICE.choice(good)
            publishers[topic].publish(made_wild(message, CHOICE.choice([0.02, 0.1, 0.5]), CHOICE))
            sent += 1
            time.sleep(0.005)
        expect(session.alive(), f"the manager has died after {sent} messages: {session.log()[-300:]}")
        peak = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{session.manager.pid}/status").read_text()).group(1)
        call("/dense_mapper/reset")
        call("/map_server/reset")
        after = session.map_bag(bag)
        expect(after == before, f"{after} points instead of {before} afterwards")
        expect(int(peak) < 1 << 20, f"the manager took {int(peak) >> 10} MiB")
    return f"{sent} messages; peak {int(peak) >> 10} MiB; {after} points afterwards, as before"


def main():
    build, runs, seconds = Path(sys.argv[1]).resolve(), int(sys.argv[2]), float(sys.argv[3])
    rows, failed = [], False
    for name, run, count in (("kill -9 in save_map", kill_in_save, runs), ("kill -9 in save_session", kill_in_save_session, runs),
                             ("kill -9 in acmp_reconstruct", kill_in_reconstruction, runs), ("full disk", full_disk, 1),
                             ("master restart", master_restart, 1), ("wild messages", wild_messages, 1)):
        print(f"== {name}", flush=True)
        try:
            seen, verdict = run(build, runs, seconds), "ok"
        except (Fault, SystemExit, subprocess.SubprocessError, OSError) as error:
            seen, verdict, failed = str(error).replace("\n", " "), "NOT OK", True
        rows.append(f"| {name} | {count} | {seen} | {verdict} |")
    print("\n| fault | runs | seen | |\n|---|---|---|---|", *rows, sep="\n")
    sys.exit(failed)


if __name__ == "__main__":
    main()
