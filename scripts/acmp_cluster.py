#!/usr/bin/python3
"""Runs acmp_reconstruct on the machines of a Dask cluster: each task is a stage of a chunk of images.

acmp_reconstruct itself plans the tasks and says which wait for which (--plan); Dask decides who does which when. The
folder OUTPUT holds all that the tasks share: every worker must see it, and SCENE, under the same name. Given again, the
same command goes on where it was stopped; the results have the same bytes as those of acmp_reconstruct alone.

  acmp_cluster.py SCENE OUTPUT                                       # on this machine, a worker for each core
  acmp_cluster.py SCENE OUTPUT --workers 2 -- --preset online        # after --: options of acmp_reconstruct
  acmp_cluster.py SCENE OUTPUT --scheduler tls://HOST:8786 --resources GPU=1 -- --device cuda

Whoever reaches a Dask scheduler runs programs as its owner. The cluster on this machine is inside this process and listens
nowhere; others need TLS with certificates on both sides: scripts/acmp_cluster.sbatch shows how.

Needs Debian's python3-distributed. Exit codes: 0 done, 2 wrong use or input, 1 failed or interrupted.
"""

import argparse
import concurrent.futures
import contextlib
import ctypes
import datetime
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

IDLE_S = 30  # after which an acmp_reconstruct ends that has nothing to do
PR_SET_PDEATHSIG = 1  # of Linux: when the parent has ended
CORES = len(os.sched_getaffinity(0))


class StageError(RuntimeError):
    """acmp_reconstruct ended with another exit code than 0."""


def count(text):
    if int(text) < 0:
        raise argparse.ArgumentTypeError(f"{text}: must be at least 0")
    return int(text)


def resources(text):
    """NAME=NUMBER, with commas between several, as a dict."""
    with contextlib.suppress(ValueError):
        found = {name: float(number) for name, number in (part.split("=") for part in text.split(","))}
        if all(found) and min(found.values()) > 0:
            return found
    raise argparse.ArgumentTypeError(f"{text}: must be NAME=NUMBER with a positive number, as GPU=1")


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
                                     usage="%(prog)s [options] SCENE OUTPUT [-- OPTIONS OF acmp_reconstruct]")
    parser.add_argument("scene", help="as for acmp_reconstruct")
    parser.add_argument("output", help="as for acmp_reconstruct; on a file system that all workers see")
    address = parser.add_mutually_exclusive_group()
    address.add_argument("--scheduler", help="address of a Dask scheduler that is there, tls://HOST:PORT")
    address.add_argument("--scheduler-file", help="file in which a Dask scheduler has written its address")
    parser.add_argument("--workers", type=count, default=0, help="of the local cluster, an acmp_reconstruct each; 0: one "
                        "per core")
    parser.add_argument("--resources", type=resources, default={}, help="what a task takes of its worker: GPU=1; workers "
                        "must be started with --resources GPU=N, those of the local cluster have it once")
    parser.add_argument("--retries", type=count, default=3, help="of a task that fails (%(default)s)")
    parser.add_argument("--program", default="acmp_reconstruct", help="acmp_reconstruct on the workers")
    parser.add_argument("--quiet", action="store_true", help="no progress; only warnings and errors")
    words = sys.argv[1:]
    end = words.index("--") if "--" in words else len(words)
    arguments = parser.parse_args(words[:end])
    arguments.options = words[end + 1:]
    arguments.workers = arguments.workers or CORES
    arguments.local = not (arguments.scheduler or arguments.scheduler_file)
    program = shutil.which(arguments.program)
    if not program:
        parser.error(f"--program {arguments.program}: not found")
    if arguments.local:
        arguments.program = program
    try:
        import distributed  # noqa: F401  takes a second: not before the arguments are checked
    except ImportError:
        parser.error("needs Dask distributed (Debian: python3-distributed)")
    return arguments


class StageProcess:
    """An acmp_reconstruct on a worker, which does one stage after the other and ends with it.

    `starter`: has one thread, as long as the worker lives: the kernel ends a process with the thread that has started it,
    and Dask's come and go."""

    def __init__(self, command, starter):
        self.command, self.timer = command, None
        # Dask sets this for its workers. It makes an allocation of an image a call of the kernel: 10 % of the time.
        environment = {name: value for name, value in os.environ.items() if name != "MALLOC_TRIM_THRESHOLD_"}
        self.program = starter.submit(
            subprocess.Popen, [*command, "--stages"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, errors="replace", env=environment,
            preexec_fn=lambda: ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)).result()

    def run(self, stage):
        """`stage`: a line for --stages. Returns what it said. After a StageError it has ended."""
        with contextlib.suppress(BrokenPipeError):  # then it answers nothing
            self.program.stdin.write(stage + "\n")
            self.program.stdin.flush()
        said, answer = [], None
        for line in self.program.stdout:
            if line.startswith(stage + ": "):
                answer = line[len(stage) + 2:].strip()
                break
            said.append(line)
        if answer == "done":
            return "".join(said).strip()
        code = self.end()
        raise StageError(f"{answer or f'exit code {code}'}\n{''.join(said)}echo {stage} | {' '.join(self.command)} --stages")

    def end(self):
        """Returns the exit code."""
        with contextlib.suppress(BrokenPipeError):
            self.program.stdin.close()
        self.program.stdout.close()
        return self.program.wait()

    @classmethod
    def take(cls, idle, command, starter):
        """One of the idle ones, or a new one. Those of other commands end, so that they hold no memory of a GPU."""
        with contextlib.suppress(IndexError):
            while True:
                process = idle.pop()
                process.timer.cancel()
                if process.command == command:
                    return process
                process.end()
        return cls(command, starter)

    def give_back(self, idle):
        self.timer = threading.Timer(IDLE_S, self.end_if_in, [idle])
        self.timer.daemon = True
        idle.append(self)
        self.timer.start()

    def end_if_in(self, idle):
        with contextlib.suppress(ValueError):  # it was taken just now
            idle.remove(self)
            self.end()


def run_stage(command, stage, *_after):
    """On a worker. `stage`: a line for --stages; `_after`: results of what it waits for."""
    from distributed import get_worker
    own = get_worker().__dict__
    idle = own.setdefault("acmp_stage_processes", [])
    starter = own.setdefault("acmp_starter", concurrent.futures.ThreadPoolExecutor(1))
    process = StageProcess.take(idle, command, starter)
    said = process.run(stage)
    process.give_back(idle)
    if said:
        print(said, flush=True)


def make_plan(arguments):
    """The tasks; none when the run is complete. Ends the program where acmp_reconstruct does."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "plan.json")
        code = subprocess.run([arguments.program, arguments.scene, arguments.output, *arguments.options, "--plan", path,
                               *["--quiet"] * arguments.quiet], check=False).returncode
        if code != 0:
            sys.exit(max(code, 1))
        with open(path, encoding="utf-8") as file:
            plan = json.load(file)
    return [] if plan["complete"] else plan["tasks"]


def connect(arguments):
    """A client, and the cluster that must be closed after it or a null context."""
    import dask
    from distributed import Client, LocalCluster
    if not arguments.local:
        client = Client(address=arguments.scheduler, scheduler_file=arguments.scheduler_file)
        if not client.scheduler.address.startswith("tls://"):
            print(f"acmp_cluster.py: warning: {client.scheduler.address} is without TLS: whoever reaches it runs programs as "
                  "its owner", file=sys.stderr, flush=True)
        return client, contextlib.nullcontext()
    # Threads of this process, which each wait for an acmp_reconstruct, and a scheduler beside them without a socket. To look
    # at threads a hundred times a second, and at the event loop fifty times, takes 5 % of a core.
    dask.config.set({"distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "1s",
                     "distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []})
    of_all = {name: number * arguments.workers for name, number in arguments.resources.items()}
    cluster = LocalCluster(n_workers=1, processes=False, threads_per_worker=arguments.workers, memory_limit=0,
                           resources=of_all or None, dashboard_address="127.0.0.1:0",
                           worker_dashboard_address="127.0.0.1:0")
    for server in (cluster.scheduler, *cluster.workers.values()):
        server.http_server.stop()  # Dask has no option for none
    return Client(cluster), cluster


def local_shares(arguments):
    """Options that share this machine's cores and memory out among those who work in a local cluster."""
    from distributed.system import MEMORY_LIMIT
    shares = {"--threads": max(1, CORES // arguments.workers),
              "--memory-limit-gb": round(MEMORY_LIMIT / 4e9 / arguments.workers, 3)}
    given = {option.partition("=")[0] for option in arguments.options}
    return [word for name, share in shares.items() if arguments.local and name not in given for word in (name, str(share))]


def submit(client, tasks, arguments):
    """Futures of all tasks."""
    of_the_run = argparse.ArgumentParser(add_help=False, allow_abbrev=False)  # what tasks do not get, or have of their own
    of_the_run.add_argument("--images")
    of_the_run.add_argument("--overwrite", action="store_true")
    options = of_the_run.parse_known_args(arguments.options)[1]
    command = [arguments.program, arguments.scene, arguments.output, *options, "--quiet"]
    shares = local_shares(arguments)
    stages = list(dict.fromkeys(task["stage"] for task in tasks))  # in their order
    futures = []
    for number, task in enumerate(tasks):
        # Late stages first, so that a chunk's images are read again while they are at hand.
        priority = stages.index(task["stage"]) * len(tasks) - number
        own = [] if task["stage"] == "finish" else shares  # the last one has the machine for itself
        futures.append(client.submit(
            run_stage, command + own, f"{task['stage']} {task['images']}".strip(),
            *[futures[other] for other in task["after"]], pure=False,
            key=f"{task['stage']}-{task['images']}-{os.getpid()}", retries=arguments.retries, priority=priority,
            resources=arguments.resources or None))
    return futures


def watch(futures, quiet):
    """Waits for all, reporting progress. Raises what a task raised."""
    from distributed import as_completed
    begin, shown = time.monotonic(), -1
    for done, future in enumerate(as_completed(futures), 1):
        future.result()
        percent = 100 * done // len(futures)
        if percent > shown and not quiet:
            shown = percent
            left = datetime.timedelta(seconds=round((time.monotonic() - begin) / done * (len(futures) - done)))
            print(f"{percent:3d} % of {len(futures)} tasks, {left} left", file=sys.stderr, flush=True)


def main():
    arguments = parse_arguments()
    tasks = make_plan(arguments)
    if not tasks:
        return
    client, cluster = connect(arguments)
    with cluster, client:
        try:
            if not (arguments.quiet or arguments.local):
                print(f"dashboard: {client.dashboard_link}", file=sys.stderr, flush=True)
            watch(submit(client, tasks, arguments), arguments.quiet)
        except StageError as error:
            sys.exit(f"acmp_cluster.py: {error}")
        except KeyboardInterrupt:
            sys.exit("acmp_cluster.py: interrupted; the same command goes on from here")
    if not arguments.quiet:
        print(f"{arguments.output}: done")


if __name__ == "__main__":
    main()
