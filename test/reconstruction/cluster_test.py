#!/usr/bin/python3
"""scripts/acmp_cluster.py on Dask clusters: the bytes of a run alone, also after workers and clients were killed.

Usage: cluster_test.py ACMP_RECONSTRUCT ACMP_MAKE_SCENE ACMP_CLUSTER. Exit code 77, which ctest shows as skipped, where
there is no Dask distributed. Environment: ACMP_ALL_STAGES=1 to kill in every stage, which takes minutes; else in some.
"""

import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import unittest.mock
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
EVERY_STAGE = ["step_0", "step_1", "step_2", "final", "maps", "finish"]
# Where a process computes long enough to be seen on any machine.
WORKER_STAGES = EVERY_STAGE if ALL_STAGES else ["step_0", "final"]
CLIENT_STAGES = EVERY_STAGE if ALL_STAGES else ["step_1"]


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(Path(folder).rglob("*"))
            if path.is_file() and path.name not in ("summary.json", ".lock")}


class ClusterTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = Path(temporary.name)
        cls.scene = str(cls.folder / "scene")
        subprocess.run([MAKE_SCENE, cls.scene, "--width", "96", "--height", "72", "--keyframes", str(IMAGES),
                        "--spacing", "0.5"], check=True, stdout=subprocess.DEVNULL)
        subprocess.run([PROGRAM, cls.scene, str(cls.folder / "alone"), *OPTIONS, "--quiet"], check=True)
        cls.alone = contents(cls.folder / "alone")

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
    def programs(root):
        """Each acmp_reconstruct that does stages below a process."""
        found = []
        with contextlib.suppress(psutil.NoSuchProcess):
            for process in psutil.Process(root.pid).children(recursive=True):
                with contextlib.suppress(psutil.Error):
                    if "--stages" in process.cmdline():
                        found.append(process)
        return found

    @staticmethod
    def is_gone(process):
        """Within ten seconds."""
        with contextlib.suppress(psutil.NoSuchProcess):
            for _ in range(1000):
                if process.status() == psutil.STATUS_ZOMBIE:
                    return True
                time.sleep(0.01)
            return False
        return True

    @staticmethod
    def files_of(output, stage):
        if stage == "finish":
            return len(list(output.glob("fused.ply*")))
        return len(list((output / "work" / stage).glob("*")))

    def wait_for_stage(self, client, root, output, stage):
        """Until a stage writes a file. Each acmp_reconstruct below `root` then; none when the client ended before."""
        before = self.files_of(output, stage)
        while client.poll() is None:
            if self.files_of(output, stage) > before:
                return self.programs(root)
            time.sleep(0.002)
        return []

    def test_same_bytes_as_alone_and_complete_afterwards(self):
        output = self.folder / "same"
        done = self.run_cluster(output)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertIn("100 % of ", done.stdout)
        self.expect_same(output)
        again = self.run_cluster(output)
        self.assertEqual(again.returncode, 0, again.stdout)
        self.assertIn("already complete", again.stdout)

    def test_workers_of_a_scheduler_killed(self):
        output = self.folder / "killed"
        address = self.folder / "scheduler.json"

        def start(module, *arguments):
            process = subprocess.Popen([sys.executable, "-m", f"distributed.cli.{module}", "--scheduler-file", str(address),
                                        "--no-dashboard", *arguments], stderr=subprocess.DEVNULL)
            self.addCleanup(process.wait, 60)
            self.addCleanup(process.terminate)
            return process
        start("dask_scheduler", "--host", "127.0.0.1", "--port", "0")
        workers = [start("dask_worker", "--nthreads", "1", "--local-directory", str(self.folder)) for _ in range(2)]
        with open(self.folder / "killed.log", "w+", encoding="utf-8") as log:
            client = subprocess.Popen(self.command(output, "--scheduler-file", str(address)), stdout=log, stderr=log)
            killed = []
            for stage in WORKER_STAGES:
                victim = len(killed) % 2
                for program in self.wait_for_stage(client, workers[victim], output, stage):
                    # A worker, or only its acmp_reconstruct: the task is tried again.
                    (program.parent() if victim == 0 else program).send_signal(signal.SIGKILL)
                    killed.append(stage)
                    self.assertTrue(self.is_gone(program), "goes with its worker")
            self.assertEqual(client.wait(timeout=300), 0, (self.folder / "killed.log").read_text()[-3000:])
        self.assertGreaterEqual(len(killed), 5 if ALL_STAGES else 1, killed)  # the shortest may not be seen
        print("killed in", killed)
        self.expect_same(output)

    def test_the_client_killed_and_started_again(self):
        output = self.folder / "client"
        killed = []
        for stage in CLIENT_STAGES:
            client = subprocess.Popen(self.command(output, "--quiet"), stdout=subprocess.DEVNULL,
                                      stderr=subprocess.DEVNULL, start_new_session=True)
            if self.wait_for_stage(client, client, output, stage):
                killed.append(stage)
                os.killpg(client.pid, signal.SIGKILL)
            client.wait(timeout=300)
        done = self.run_cluster(output)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertGreaterEqual(len(killed), 4 if ALL_STAGES else 1, killed)
        print("client killed in", killed)
        self.expect_same(output)

    def test_a_process_ends_when_it_fails_is_idle_or_another_is_wanted(self):
        spec = importlib.util.spec_from_file_location("acmp_cluster", CLUSTER)
        cluster = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(cluster)
        command = [PROGRAM, self.scene, str(self.folder / "alone"), *OPTIONS]
        idle = []
        with unittest.mock.patch.dict(os.environ, {"MALLOC_TRIM_THRESHOLD_": "65536", "OTHER": "kept"}):
            process = cluster.StageProcess.take(idle, command)
        environment = psutil.Process(process.program.pid).environ()
        self.assertEqual((environment.get("MALLOC_TRIM_THRESHOLD_"), environment.get("OTHER")), (None, "kept"))
        self.assertIn("already complete", process.run("step_0 0-3"))
        process.give_back(idle)
        self.assertIs(cluster.StageProcess.take(idle, command), process)
        with self.assertRaisesRegex(cluster.StageError, "(?s)^exit code 2: --stages: line .* --stage step_0 --images"):
            process.run("step_0 0 1")
        self.assertEqual(process.program.returncode, 1)
        process = cluster.StageProcess.take(idle, command)
        process.program.kill()
        with self.assertRaisesRegex(cluster.StageError, "^exit code -9\n"):
            process.run("step_0 0-3")
        with self.assertRaisesRegex(cluster.StageError, "^exit code 2\n.*--seed"):
            cluster.StageProcess.take(idle, [*command, "--seed", "nonsense"]).run("step_0 0-3")
        first = cluster.StageProcess.take(idle, command)
        first.give_back(idle)
        cluster.IDLE_S = 0.1
        second = cluster.StageProcess.take(idle, [*command, "--seed", "2"])
        self.assertEqual(first.program.returncode, 0)
        second.give_back(idle)
        second.timer.join()
        self.assertEqual((second.program.returncode, idle), (0, []))

    def test_a_task_that_fails_and_wrong_use_say_why(self):
        bad = self.run_cluster(self.folder / "bad", "--retries", "0", "--program", "/bin/false")
        self.assertEqual(bad.returncode, 1, bad.stdout)
        done = subprocess.run([*self.command(self.folder / "bad2"), "--seed", "nonsense"], stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, check=False, timeout=300)
        self.assertEqual(done.returncode, 2, done.stdout)
        self.assertIn("--seed", done.stdout)
        for arguments, words in ((["--resources", "GPU"], "NAME=NUMBER"), (["--workers", "-1"], "at least 0"),
                                 (["--program", "no_such_program"], "not found")):
            done = self.run_cluster(self.folder / "wrong", *arguments)
            self.assertEqual(done.returncode, 2, done.stdout)
            self.assertIn(words, done.stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
