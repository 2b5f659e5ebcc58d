#!/usr/bin/python3
"""scripts/acmp_cluster.py on a local Dask cluster: the bytes of a run alone, also after workers and clients were killed.

Usage: cluster_test.py ACMP_RECONSTRUCT ACMP_MAKE_SCENE ACMP_CLUSTER. Exit code 77, which ctest shows as skipped, where
there is no Dask distributed. Environment: ACMP_ALL_STAGES=1 to kill in every stage, which takes minutes; else in some.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

try:
    import distributed  # noqa: F401
    import psutil
except ImportError as error:
    print(f"skipped: {error} (Debian: python3-distributed)")
    sys.exit(77)

PROGRAM, MAKE_SCENE, CLUSTER = sys.argv[1:4]
OPTIONS = ["--device", "cpu", "--preset", "online", "--max-image-size", "48", "--chunk-images", "4"]
IMAGES = 12
ALL_STAGES = os.environ.get("ACMP_ALL_STAGES") == "1"
EVERY_STAGE = ["step_0", "step_1", "step_2", "final", "maps", "fuse", "finish"]
# Where a process computes long enough to be seen on any machine.
WORKER_STAGES = EVERY_STAGE if ALL_STAGES else ["step_0", "final"]
CLIENT_STAGES = EVERY_STAGE if ALL_STAGES else ["step_1"]


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(Path(folder).rglob("*"))
            if path.is_file() and path.name not in ("summary.json", ".lock")}


class ClusterTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = Path(cls.temporary.name)
        cls.scene = str(cls.folder / "scene")
        subprocess.run([MAKE_SCENE, cls.scene, "--width", "96", "--height", "72", "--keyframes", str(IMAGES),
                        "--spacing", "0.5"], check=True, stdout=subprocess.DEVNULL)
        subprocess.run([PROGRAM, cls.scene, str(cls.folder / "alone"), *OPTIONS, "--quiet"], check=True)
        cls.alone = contents(cls.folder / "alone")

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def command(self, output, *arguments):
        return [sys.executable, CLUSTER, "--program", PROGRAM, "--workers", "2", self.scene, str(output), *arguments,
                "--", *OPTIONS]

    def run_cluster(self, output, *arguments):
        return subprocess.run(self.command(output, *arguments), stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              text=True, check=False, timeout=300)

    def expect_same(self, output):
        found = contents(output)
        self.assertEqual(sorted(found), sorted(self.alone))
        for name, content in found.items():
            self.assertEqual(content, self.alone[name], name)

    @staticmethod
    def stage_process(client, stage):
        """The acmp_reconstruct that does this stage below a client, and its worker; or None."""
        try:
            for process in psutil.Process(client.pid).children(recursive=True):
                try:
                    line = process.cmdline()
                    if "--stage" in line and line[line.index("--stage") + 1] == stage:
                        return process, process.parent()
                except (psutil.NoSuchProcess, psutil.AccessDenied, psutil.ZombieProcess, IndexError):
                    continue
        except psutil.NoSuchProcess:
            pass
        return None

    @staticmethod
    def is_gone(process):
        """Within ten seconds."""
        for _ in range(1000):
            try:
                if process.status() == psutil.STATUS_ZOMBIE:
                    return True
            except psutil.NoSuchProcess:
                return True
            time.sleep(0.01)
        return False

    def wait_for_stage(self, client, stage):
        while client.poll() is None:
            found = self.stage_process(client, stage)
            if found and found[1] and found[1].pid != client.pid:
                return found
            time.sleep(0.002)
        return None

    def test_same_bytes_as_alone_and_complete_afterwards(self):
        output = self.folder / "same"
        done = self.run_cluster(output)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertIn("100 % of ", done.stdout)
        self.expect_same(output)
        again = self.run_cluster(output)
        self.assertEqual(again.returncode, 0, again.stdout)
        self.assertIn("already complete", again.stdout)

    def test_workers_killed(self):
        output = self.folder / "killed"
        with open(self.folder / "killed.log", "w+", encoding="utf-8") as log:
            client = subprocess.Popen(self.command(output), stdout=log, stderr=log)
            killed = []
            for stage in WORKER_STAGES:
                found = self.wait_for_stage(client, stage)
                if not found:
                    continue
                program, worker = found
                worker.send_signal(signal.SIGKILL)
                killed.append(stage)
                self.assertTrue(self.is_gone(program), "goes with its worker")
            self.assertEqual(client.wait(timeout=300), 0, (self.folder / "killed.log").read_text()[-3000:])
        self.assertGreaterEqual(len(killed), 5 if ALL_STAGES else 1, killed)  # the shortest may be over before it is seen
        print("workers killed in", killed)
        self.expect_same(output)

    def test_the_client_killed_and_started_again(self):
        output = self.folder / "client"
        killed = []
        for stage in CLIENT_STAGES:
            client = subprocess.Popen(self.command(output, "--quiet"), stdout=subprocess.DEVNULL,
                                      stderr=subprocess.DEVNULL, start_new_session=True)
            if self.wait_for_stage(client, stage):
                killed.append(stage)
                os.killpg(client.pid, signal.SIGKILL)
            client.wait(timeout=300)
        done = self.run_cluster(output)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertGreaterEqual(len(killed), 4 if ALL_STAGES else 1, killed)
        print("client killed in", killed)
        self.expect_same(output)

    def test_a_task_that_fails_says_why(self):
        bad = self.run_cluster(self.folder / "bad", "--retries", "0", "--program", "/bin/false")
        self.assertEqual(bad.returncode, 1, bad.stdout)
        done = subprocess.run([*self.command(self.folder / "bad2"), "--seed", "nonsense"], stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, check=False, timeout=300)
        self.assertEqual(done.returncode, 2, done.stdout)
        self.assertIn("--seed", done.stdout)

    def test_wrong_use(self):
        for arguments, words in ((["--resources", "GPU"], "NAME=NUMBER"), (["--workers", "-1"], "at least 0"),
                                 (["--program", "no_such_program"], "not found")):
            done = self.run_cluster(self.folder / "wrong", *arguments)
            self.assertEqual(done.returncode, 2, done.stdout)
            self.assertIn(words, done.stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
