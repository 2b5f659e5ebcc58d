#!/usr/bin/python3
"""Compares the #include lines with the table of modules in docs/architecture.md, and who may name ROS and CUDA.

usage: module_dependencies_test.py SOURCE_FOLDER"""
import collections
import glob
import os
import re
import sys
import unittest

SOURCE = os.path.abspath(sys.argv.pop(1))
ROS_HEADER = re.compile(r'#include <(?:ros|rosbag|nodelet|pluginlib|tf2\w*|\w+_msgs|sensor_msgs|dynamic_reconfigure|'
                        r'cv_bridge|image_transport|diagnostic_updater|acmp_mapping)/')
CUDA_HEADER = re.compile(r"#include <cuda")


def sources():
    """(module, path, text) of every header and source file outside test/."""
    for pattern in ("include/acmp_mapping/*/**/*", "src/*/**/*", "cuda/**/*"):
        for path in glob.glob(os.path.join(SOURCE, pattern), recursive=True):
            if not path.endswith((".h", ".cpp", ".cu")):
                continue
            parts = os.path.relpath(path, SOURCE).split(os.sep)
            module = parts[{"include": 2, "src": 1, "cuda": 0}[parts[0]]]
            with open(path) as file:
                yield module, os.path.relpath(path, SOURCE), file.read()


def documented():
    with open(os.path.join(SOURCE, "docs/architecture.md")) as file:
        section = file.read().split("## Modules and what they may include")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (\w+) \|([\w, ]*)\|$", section, re.MULTILINE)
    return {module: set(re.findall(r"\w+", allowed)) for module, allowed in rows if module != "module"}


class ModuleDependencies(unittest.TestCase):
    def test_includes_are_allowed_by_the_table(self):
        included = collections.defaultdict(set)
        for module, _, text in sources():
            included[module] |= set(re.findall(r'#include "acmp_mapping/(\w+)/', text)) - {module}
        table = documented()
        self.assertEqual(set(table), set(included))
        for module, allowed in table.items():
            self.assertLessEqual(included[module], allowed, module)

    def test_no_cycles(self):
        table = documented()
        done = set()
        while len(done) < len(table):
            ready = {module for module, allowed in table.items() if module not in done and allowed <= done}
            self.assertTrue(ready, "a cycle among %s" % (set(table) - done))
            done |= ready

    def test_ros_stays_in_its_place(self):
        users = {path for _, path, text in sources() if ROS_HEADER.search(text)}
        outside = [path for path in users if "/ros/" not in path and not path.startswith("src/tools/bag_")]
        self.assertEqual(outside, [])
        self.assertTrue(users)

    def test_cuda_stays_in_its_place(self):
        users = {path for _, path, text in sources() if CUDA_HEADER.search(text)}
        self.assertEqual([path for path in users if not path.startswith("cuda/")], [])
        self.assertTrue(users)


if __name__ == "__main__":
    unittest.main(verbosity=2)
