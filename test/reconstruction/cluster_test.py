#!/usr/bin/python3
"""scripts/acmp_cluster.py on Dask clusters: the bytes of a run alone, also after workers and clients were killed.

Usage: cluster_test.py ACMP_RECONSTRUCT ACMP_MAKE_SCENE ACMP_CLUSTER. Exit code 77, which ctest shows as skipped, where
there is no Dask distributed. Environment: ACMP_ALL_STAGES=1 to kill in every stage, which takes minutes; else in some.
"""

import concurrent.futures
import contextlib
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
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
WORKER_STAGES = EVERY_STAGE if ALL_STAGES else ["step_0", "final"]
CLIENT_STAGES = EVERY_STAGE if ALL_STAGES else ["step_1"]

# acmp_reconstruct, but the first process that is to do a stage that a file in {held} names does nothing more: it renames the
# file to STAGE.PID, and waits to be killed.
HELD = """#!/usr/bin/python3
import os, signal, subprocess, sys
if "--stages" not in sys.argv:
    os.execv({program!r}, [{program!r}, *sys.argv[1:]])
program = subprocess.Popen([{program!r}, *sys.argv[1:]], stdin=subprocess.PIPE, text=True)
for line in sys.stdin:
    stage = line.split()[0]
    try:
        os.rename(f"{held}/{{stage}}", f"{held}/{{stage}}.{{os.getpid()}}")
    except FileNotFoundError:
        print(line, end="", file=program.stdin, flush=True)
    else:
        signal.pause()
program.stdin.close()
sys.exit(program.wait())
"""


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

    def hold(self, name, stages):
        """A program for the cluster, and the folder of those of it that are held."""
        held = self.folder / f"held_{name}"
        held.mkdir()
        for stage in stages:
            (held / stage).touch()
        program = self.folder / f"program_{name}"
        program.write_text(HELD.format(program=PROGRAM, held=held))
        program.chmod(0o755)
        return str(program), held

    @staticmethod
    def wait_for_held(client, held, stage):
        """The process that is held in a stage."""
        while not list(held.glob(f"{stage}.*")):
            assert client.poll() is None, f"ended before {stage}"
            time.sleep(0.01)
        return psutil.Process(int(next(held.glob(f"{stage}.*")).suffix[1:]))

    @staticmethod
    def module():
        spec = importlib.util.spec_from_file_location("acmp_cluster", CLUSTER)
        cluster = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(cluster)
        return cluster

    @staticmethod
    def is_gone(process):
        """Within a minute."""
        with contextlib.suppress(psutil.NoSuchProcess):
            for _ in range(6000):
                if process.status() == psutil.STATUS_ZOMBIE:
                    return True
                time.sleep(0.01)
            return False
        return True

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
        for _ in range(2):
            start("dask_worker", "--nthreads", "1", "--local-directory", str(self.folder))
        program, held = self.hold("killed", WORKER_STAGES)
        with open(self.folder / "killed.log", "w+", encoding="utf-8") as log:
            client = subprocess.Popen(self.command(output, "--scheduler-file", str(address), "--program", program),
                                      stdout=log, stderr=log)
            for number, stage in enumerate(WORKER_STAGES):
                process = self.wait_for_held(client, held, stage)
                # A worker, or only its acmp_reconstruct: the task is tried again.
                (process.parent() if number % 2 == 0 else process).kill()
                self.assertTrue(self.is_gone(process), "goes with its worker")
            self.assertEqual(client.wait(timeout=300), 0, (self.folder / "killed.log").read_text()[-3000:])
        self.expect_same(output)

    def test_a_local_cluster_listens_nowhere(self):
        program, held = self.hold("local", ["step_0"])
        client = subprocess.Popen(self.command(self.folder / "local", "--program", program), stdout=subprocess.DEVNULL,
                                  stderr=subprocess.DEVNULL)
        self.addCleanup(client.wait)
        self.addCleanup(client.kill)
        process = self.wait_for_held(client, held, "step_0")
        family = [psutil.Process(client.pid), *psutil.Process(client.pid).children(recursive=True)]
        self.assertIn(process, family)
        self.assertEqual([c.laddr for one in family for c in one.connections("inet") if c.status == "LISTEN"], [])
        process.kill()
        self.assertEqual(client.wait(timeout=300), 0)

    def test_a_process_outlives_the_task_that_started_it(self):
        cluster = self.module()
        starter, idle = concurrent.futures.ThreadPoolExecutor(1), []
        command = [PROGRAM, self.scene, str(self.folder / "alone"), *OPTIONS]
        taken = []
        thread = threading.Thread(target=lambda: taken.append(cluster.StageProcess.take(idle, command, starter)))
        thread.start()
        thread.join()
        self.assertIn("already complete", taken[0].run("step_0 0-3"))
        taken[0].end()

    @unittest.skipUnless(shutil.which("openssl") and shutil.which("dask-scheduler"), "needs openssl and dask-scheduler")
    def test_a_slurm_job_takes_none_without_its_certificate(self):
        bin_folder, jobs = self.folder / "bin", self.folder / "jobs"
        for folder in (bin_folder, jobs):
            folder.mkdir()
        for name, target in (("acmp_reconstruct", PROGRAM), ("acmp_cluster.py", CLUSTER)):
            (bin_folder / name).symlink_to(target)
        (bin_folder / "srun").write_text('#!/bin/sh\nexec "$@"\n')
        (bin_folder / "srun").chmod(0o755)
        program, held = self.hold("slurm", ["step_0"])
        output = self.folder / "slurm"
        with open(self.folder / "slurm.log", "w+", encoding="utf-8") as log:
            job = subprocess.Popen([str(Path(CLUSTER).with_suffix(".sbatch")), self.scene, str(output), "--program", program,
                                    "--", *OPTIONS], stdout=log, stderr=log, cwd=self.folder,
                                   env={**os.environ, "PATH": f"{bin_folder}:{os.environ['PATH']}", "SLURM_JOB_ID": "7",
                                        "SLURM_SUBMIT_DIR": str(jobs)})
            self.addCleanup(job.wait)
            self.addCleanup(job.terminate)  # ends what it has started
            process = self.wait_for_held(job, held, "step_0")
            [folder] = jobs.iterdir()
            self.assertEqual(folder.stat().st_mode & 0o077, 0)
            address = json.loads((folder / "scheduler.json").read_text())["address"]
            self.assertTrue(address.startswith("tls://"), address)
            for other in (address, address.replace("tls://", "tcp://")):
                with self.assertRaises((OSError, TypeError, ValueError, RuntimeError)):  # TypeError: no TLS context
                    distributed.Client(other, timeout=3)
            process.kill()
            self.assertEqual(job.wait(timeout=300), 0, (self.folder / "slurm.log").read_text()[-3000:])
        self.expect_same(output)
        self.assertEqual(list(jobs.iterdir()), [])

    def test_the_client_killed_and_started_again(self):
        output = self.folder / "client"
        for stage in CLIENT_STAGES:
            program, held = self.hold(f"client_{stage}", [stage])
            client = subprocess.Popen(self.command(output, "--quiet", "--program", program), stdout=subprocess.DEVNULL,
                                      stderr=subprocess.DEVNULL, start_new_session=True)
            self.wait_for_held(client, held, stage)
            os.killpg(client.pid, signal.SIGKILL)
            client.wait(timeout=300)
        done = self.run_cluster(output)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.expect_same(output)

    def test_a_process_ends_when_it_fails_is_idle_or_another_is_wanted(self):
        cluster = self.module()
        command = [PROGRAM, self.scene, str(self.folder / "alone"), *OPTIONS]
        idle = []
        starter = concurrent.futures.ThreadPoolExecutor(1)
        with unittest.mock.patch.dict(os.environ, {"MALLOC_TRIM_THRESHOLD_": "65536", "OTHER": "kept"}):
            process = cluster.StageProcess.take(idle, command, starter)
        environment = psutil.Process(process.program.pid).environ()
        self.assertEqual((environment.get("MALLOC_TRIM_THRESHOLD_"), environment.get("OTHER")), (None, "kept"))
        self.assertIn("already complete", process.run("step_0 0-3"))
        process.give_back(idle)
        self.assertIs(cluster.StageProcess.take(idle, command, starter), process)
        with self.assertRaisesRegex(cluster.StageError, "(?s)^exit code 2: --stages: line .*echo step_0 0 1 .* --stages"):
            process.run("step_0 0 1")
        self.assertEqual(process.program.returncode, 1)
        process = cluster.StageProcess.take(idle, command, starter)
        process.program.kill()
        with self.assertRaisesRegex(cluster.StageError, "^exit code -9\n"):
            process.run("step_0 0-3")
        with self.assertRaisesRegex(cluster.StageError, "^exit code 2\n.*--seed"):
            cluster.StageProcess.take(idle, [*command, "--seed", "nonsense"], starter).run("step_0 0-3")
        first = cluster.StageProcess.take(idle, command, starter)
        first.give_back(idle)
        cluster.IDLE_S = 0.1
        second = cluster.StageProcess.take(idle, [*command, "--seed", "2"], starter)
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
