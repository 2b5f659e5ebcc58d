#!/usr/bin/env python3
"""See faults.sh. Usage: faults.py BUILD RUNS SECONDS [FAULT...]"""
import collections
import copy
import math
import os
import random
import re
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from io import BytesIO
from pathlib import Path

import genpy
import numpy as np
import rosbag
import rospy
from acmp_mapping.msg import KeyframePoints
from dynamic_reconfigure import DynamicReconfigureCallbackException, DynamicReconfigureParameterException
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PoseStamped, Transform, TransformStamped
from nav_msgs.msg import Path as RosPath
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from nodelet_session import TOPICS, Session, call, make_bag, save_map, save_session, wait_for

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
    changed = type(message)().deserialize(buffer.getvalue())
    make_wild(changed, share, choice)
    return changed


def withstand(build, attack, **parameters):
    """The manager lives, takes no memory for what a message claims, and maps what follows as before. attack(session, bag)
    says what it has done. parameters: of Session."""
    with tempfile.TemporaryDirectory() as folder, Session(folder, **parameters) as session:
        rospy.init_node("faults", disable_signals=True)
        # Where poses are those of a body: it is the camera.
        body = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        body.publish(TFMessage([transform("body", "camera_optical")]))
        bag = make_bag(build, f"{folder}/room.bag")
        before = session.map_bag(bag)
        seen = attack(session, bag)
        expect(session.alive(), f"the manager has died after {seen}: {session.log()[-300:]}")
        peak = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{session.manager.pid}/status").read_text()).group(1)
        call("/dense_mapper/reset")
        call("/map_server/reset")
        after = session.map_bag(bag)
        expect(after == before, f"{after} points instead of {before} afterwards")
        expect(int(peak) < 1 << 20, f"the manager took {int(peak) >> 10} MiB")
    return f"{seen}; peak {int(peak) >> 10} MiB; {after} points afterwards, as before"


def transform(frame, child, stamp=genpy.Time(1)):
    message = TransformStamped(Header(0, stamp, frame), child, Transform())
    message.transform.rotation.w = 1
    return message


def keyframe_points():
    """The room's keyframes as the mapper sends them."""
    points = []
    subscriber = rospy.Subscriber("/keyframe_points", KeyframePoints, points.append, queue_size=100)
    return points, subscriber


def send_wild(session, seconds, good, shares=(0.02, 0.1, 0.5)):
    """good: topics with messages"""
    publishers = {topic: rospy.Publisher(topic, type(message), queue_size=10) for topic, message in dict(good).items()}
    time.sleep(2)
    sent, end = 0, time.monotonic() + seconds
    while time.monotonic() < end and session.alive():
        topic, message = CHOICE.choice(good)
        publishers[topic].publish(made_wild(message, CHOICE.choice(shares), CHOICE))
        sent += 1
        time.sleep(0.005)
    return f"{sent} messages"


def wild_messages(build, _runs, seconds):
    def attack(session, bag):
        points, _ = keyframe_points()
        session.map_bag(bag)
        wait_for(lambda: points, "keyframe_points")
        good = [(topic, message) for topic, message, _ in rosbag.Bag(bag).read_messages(topics=list(TOPICS.values()))]
        image, info = (next(message for topic, message in good if topic == TOPICS[name]) for name in ("image", "camera_info"))
        poses = [message for topic, message in good if topic == TOPICS["pose"]]
        mask = Image(image.header, image.height, image.width, "mono8", 0, image.width, bytes(image.height * image.width))
        depth = Image(image.header, image.height, image.width, "16UC1", 0, 2 * image.width, bytes(2 * image.height * image.width))
        good += [("/prior_depth", depth), ("/keyframe_points", points[0]), ("/mask", mask), ("/source_image", image),
                 ("/source_camera_info", info), ("/optimized_path", RosPath(PoseStamped().header, poses))]
        return send_wild(session, seconds, good)
    source = {"source_cameras": 1, "T_cam_source": [1, 0, 0, 0.1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
    return withstand(build, attack, mapper_parameters=source)


def tf(build, _runs, seconds):
    """Frames that are used and others, with stamps of another century and transforms of no meaning."""
    good = [("/tf", TFMessage([transform(*frames)])) for frames in
            (("body", "camera_optical"), ("world", "body"), ("world", "camera_optical"), ("x", "body"))]
    return withstand(build, lambda session, bag: send_wild(session, seconds, good),
                     mapper_parameters={"pose_child": "body", "body_frame": "body"})


def clock(build, _runs, seconds):
    good = [("/clock", Clock(genpy.Time(1600000000)))]
    return withstand(build, lambda session, bag: send_wild(session, seconds, good), global_parameters={"use_sim_time": True})


def parameters(build, _runs, seconds):
    """Those that are read while the nodelets run: on the server and by dynamic_reconfigure."""
    def attack(session, bag):
        before = rospy.get_param("/dense_mapper")
        client, changes, end = Client("/dense_mapper", timeout=60), 0, time.monotonic() + seconds
        while time.monotonic() < end and session.alive():
            rospy.set_param(CHOICE.choice(["/dense_mapper", "/map_server"]) + "/diagnostic_period",
                            CHOICE.choice([1e12, -1e12, 5e9, math.nan, math.inf, 0.0, 1e-300, "text", [1], 0.5]))
            name, value = CHOICE.choice([item for item in client.get_configuration().items() if item[0] != "groups"])
            wild = wild_number("int32" if isinstance(value, int) else "float64", value, CHOICE)
            try:
                client.update_configuration({name: wild})
            except (DynamicReconfigureParameterException, DynamicReconfigureCallbackException, rospy.ServiceException):
                pass
            changes += 1
        client.update_configuration({name: value for name, value in before.items() if name in client.get_configuration()})
        for node in ("/dense_mapper", "/map_server"):
            rospy.set_param(node + "/diagnostic_period", 1.0)
        return f"{changes} changes"
    return withstand(build, attack)


def occupancy(build, _runs, _seconds):
    """Keyframes that are far from each other, and whose points are far from them, in a map with voxels for a room."""
    def attack(session, bag):
        points, subscriber = keyframe_points()
        session.map_bag(bag)
        wait_for(lambda: points, "keyframe_points")
        subscriber.unregister()
        publisher = rospy.Publisher("/keyframe_points", KeyframePoints, queue_size=10)
        time.sleep(2)
        slowest_s = 0
        for i, (away, scale) in enumerate(((60, 1), (600, 1), (1400, 1), (0, 30), (0, 100), (0, 1000))):
            far = copy.deepcopy(points[0])
            far.mapper, far.count, far.id = "/far", i + 1, i + 1
            far.T_world_cam = [v + away if at in (3, 7) else v for at, v in enumerate(far.T_world_cam)]
            floats = np.frombuffer(far.points.data, np.float32).reshape(-1, far.points.point_step // 4).copy()
            floats[:, :3] *= scale
            far.points.data = floats.tobytes()
            publisher.publish(far)
            time.sleep(1)
            begin = time.monotonic()
            expect("success: True" in call("/map_server/publish_map"), "publish_map gives no answer")
            call("/map_server/save_map", "{path: map.bt, format: 4, binary: true}")
            slowest_s = max(slowest_s, time.monotonic() - begin)
        expect(slowest_s < 120, f"map services took {slowest_s:.0f} s")
        return f"{i + 1} keyframes; services within {slowest_s:.1f} s"
    return withstand(build, attack)


def sessions(build, runs, _seconds):
    """Files that are cut off or in which numbers are others: loaded whole, or not at all."""
    def attack(session, bag):
        session.map_bag(bag)
        path = session.folder / "whole.bag"
        expect("success: True" in save_session(path), "save_session")
        whole, answers = path.read_bytes(), collections.Counter()
        fields = [at.end() for name in (rb"count=", b"conn=", b"size=", b"chunk_pos=", b"index_pos=", b"conn_count=")
                  for at in re.finditer(name, whole)]
        fields += 20 * [at.end() + 24 for at in re.finditer(rb"op=\x04", whole)]  # where an index says that its first message is
        for run in range(20 * runs):
            at, kind = CHOICE.choice(fields), run % 3
            number = CHOICE.choice([0, 1, 13, 1 << 20, 1 << 30, (1 << 32) - 1, len(whole)]).to_bytes(4, "little")
            if kind == 0:
                content = whole[:CHOICE.randrange(len(whole))]
            else:
                at = at if kind == 1 else CHOICE.randrange(len(whole) - 4)
                content = whole[:at] + number + whole[at + 4:]
            Path(session.folder, "damaged.bag").write_bytes(content)
            call("/map_server/reset")
            answer = call("/map_server/load_session", "{path: damaged.bag}")
            expect(answer and session.alive(), f"no answer for a damaged session: {session.log()[-300:]}")
            answers["success: True" in answer] += 1
        return f"{answers[False]} of {20 * runs} damaged files refused"
    return withstand(build, attack)


def main():
    build, runs, seconds = Path(sys.argv[1]).resolve(), int(sys.argv[2]), float(sys.argv[3])
    rows, failed = [], False
    faults = (("kill -9 in save_map", kill_in_save, runs), ("kill -9 in save_session", kill_in_save_session, runs),
              ("full disk", full_disk, 1),
              ("master restart", master_restart, 1), ("wild messages", wild_messages, 1), ("tf", tf, 1), ("clock", clock, 1),
              ("parameters", parameters, 1), ("occupancy", occupancy, 1), ("sessions", sessions, 20 * runs))
    for name, run, count in [fault for fault in faults if fault[0] in sys.argv[4:] or not sys.argv[4:]]:
        print(f"== {name}", flush=True)
        try:
            with ProcessPoolExecutor(1) as pool:  # rospy knows one master in a process
                seen, verdict = pool.submit(run, build, runs, seconds).result(), "ok"
        except (Fault, SystemExit, subprocess.SubprocessError, OSError) as error:
            seen, verdict, failed = str(error).replace("\n", " "), "NOT OK", True
        rows.append(f"| {name} | {count} | {seen} | {verdict} |")
    print("\n| fault | runs | seen | |\n|---|---|---|---|", *rows, sep="\n")
    sys.exit(failed)


if __name__ == "__main__":
    main()
