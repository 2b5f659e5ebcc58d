#!/usr/bin/python3
"""Runs acmp_reconstruct on the machines of a Dask cluster: each task is a stage of a chunk of images.

acmp_reconstruct itself plans the tasks and says which wait for which (--plan); Dask decides who does which when. The
folder OUTPUT holds all that the tasks share: every worker must see it, and SCENE, under the same name. Given again, the
same command goes on where it was stopped; the results have the same bytes as those of acmp_reconstruct alone.

  acmp_cluster.py SCENE OUTPUT                                       # on this machine, a worker for each core
  acmp_cluster.py SCENE OUTPUT --workers 2 -- --preset online        # after --: options of acmp_reconstruct
  acmp_cluster.py SCENE OUTPUT --scheduler tcp://HOST:8786 --resources GPU=1 -- --device cuda

Needs Debian's python3-distributed. Exit codes: 0 done, 2 wrong use or input, 1 failed or interrupted.
"""

import argparse
import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

EXIT_DONE, EXIT_FAILED = 0, 1
IDLE_S = 30  # after which an acmp_reconstruct ends that has nothing to do


class StageError(RuntimeError):
    """acmp_reconstruct ended with another exit code than 0."""


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
                                     usage="%(prog)s [options] SCENE OUTPUT [-- OPTIONS OF acmp_reconstruct]")
    parser.add_argument("scene", help="as for acmp_reconstruct")
    parser.add_argument("output", help="as for acmp_reconstruct; on a file system that all workers see")
    parser.add_argument("--scheduler", help="address of a Dask scheduler that is there, tcp://HOST:PORT")
    parser.add_argument("--scheduler-file", help="file in which a Dask scheduler has written its address")
    parser.add_argument("--workers", type=int, default=0, help="of the local cluster, an acmp_reconstruct each; 0: one "
                        "per core")
    parser.add_argument("--resources", default="", help="what a task takes of its worker: GPU=1; workers must be "
                        "started with --resources GPU=N, those of the local cluster have it once")
    parser.add_argument("--retries", type=int, default=3, help="of a task that fails (%(default)s)")
    parser.add_argument("--program", default="acmp_reconstruct", help="acmp_reconstruct on the workers")
    parser.add_argument("--dashboard", default=":0", help="address of the local cluster's dashboard; needs bokeh")
    parser.add_argument("--quiet", action="store_true", help="no progress; only warnings and errors")
    words = sys.argv[1:]
    end = words.index("--") if "--" in words else len(words)
    arguments = parser.parse_args(words[:end])
    arguments.options = words[end + 1:]
    if arguments.scheduler and arguments.scheduler_file:
        parser.error("--scheduler and --scheduler-file: give one of them")
    for name in ("workers", "retries"):
        if getattr(arguments, name) < 0:
            parser.error(f"--{name} {getattr(arguments, name)}: must be at least 0")
    return arguments, parser


def parse_resources(text, parser):
    resources = {}
    for part in filter(None, text.split(",")):
        name, equals, count = part.partition("=")
        try:
            resources[name] = float(count)
        except ValueError:
            equals = ""
        if not name or not equals or resources[name] <= 0:
            parser.error(f"--resources {text}: must be NAME=NUMBER with a positive number, as GPU=1")
    return resources


def die_with_parent():
    """A worker that is killed takes its acmp_reconstruct with it (Linux)."""
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


class StageProcess:
    """An acmp_reconstruct on a worker, which does one stage after the other."""

    def __init__(self, command):
        self.command = command
        self.timer = None
        # Dask sets this for its workers. It makes an allocation of an image a call of the kernel: 10 % of the time.
        environment = {name: value for name, value in os.environ.items() if name != "MALLOC_TRIM_THRESHOLD_"}
        self.program = subprocess.Popen([*command, "--stages"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.STDOUT, text=True, errors="replace", env=environment,
                                        preexec_fn=die_with_parent)

    def run(self, stage):
        """`stage`: a line for --stages. Returns what it said. After a StageError it has ended."""
        try:
            self.program.stdin.write(stage + "\n")
            self.program.stdin.flush()
        except BrokenPipeError:
            pass  # then it answers nothing
        said, answer = [], None
        for line in self.program.stdout:
            if line.startswith(stage + ": "):
                answer = line[len(stage) + 2:].strip()
                break
            said.append(line)
        if answer == "done":
            return "".join(said).strip()
        code = self.end()
        name, _, images = stage.partition(" ")
        alone = [*self.command, "--stage", name] + (["--images", images] if images else [])
        raise StageError(f"{answer or f'exit code {code}'}\n{''.join(said)}{' '.join(alone)}")

    def end(self):
        """Returns the exit code."""
        try:
            self.program.stdin.close()
        except BrokenPipeError:
            pass
        self.program.stdout.close()
        return self.program.wait()

    @classmethod
    def take(cls, idle, command):
        """One of the idle ones, or a new one. Those of other commands end, so that they hold no memory of a GPU."""
        while True:
            try:
                process = idle.pop()
            except IndexError:
                return cls(command)
            process.timer.cancel()
            if process.command == command:
                return process
            process.end()

    def give_back(self, idle):
        self.timer = threading.Timer(IDLE_S, self.end_if_in, [idle])
        self.timer.daemon = True
        idle.append(self)
        self.timer.start()

    def end_if_in(self, idle):
        try:
            idle.remove(self)
        except ValueError:
            return  # it was taken just now
        self.end()


def run_stage(command, stage, *_after):
    """On a worker. `stage`: a line for --stages; `_after`: results of what it waits for. Returns seconds."""
    from distributed import get_worker
    begin = time.monotonic()
    idle = get_worker().__dict__.setdefault("acmp_stage_processes", [])
    process = StageProcess.take(idle, command)
    said = process.run(stage)
    process.give_back(idle)
    if said:
        print(said, flush=True)
    return time.monotonic() - begin


def make_plan(program, arguments):
    """The tasks; None when the run is complete. Ends the program where acmp_reconstruct does."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "plan.json")
        command = [program, arguments.scene, arguments.output, *arguments.options, "--plan", path]
        if arguments.quiet:
            command.append("--quiet")
        code = subprocess.run(command, check=False).returncode
        if code != EXIT_DONE:
            sys.exit(code if code > 0 else EXIT_FAILED)
        with open(path, encoding="utf-8") as file:
            plan = json.load(file)
    return None if plan["complete"] else plan["tasks"]


def connect(arguments, resources):
    """A client, and the cluster that must be closed after it or None."""
    import dask
    from distributed import Client, LocalCluster  # not before the arguments are checked: takes a second
    if arguments.scheduler or arguments.scheduler_file:
        return Client(address=arguments.scheduler, scheduler_file=arguments.scheduler_file), None
    # One process whose threads each wait for an acmp_reconstruct: each further process takes 0.7 s of a core to start.
    # To look at its threads a hundred times a second, and at the event loop fifty times, takes 5 % of a core.
    dask.config.set({"distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "1s"})
    workers = local_workers(arguments)
    cluster = LocalCluster(n_workers=1, threads_per_worker=workers, memory_limit=0,
                           resources={name: count * workers for name, count in resources.items()} or None,
                           dashboard_address=arguments.dashboard)
    return Client(cluster), cluster


def local_workers(arguments):
    return arguments.workers or len(os.sched_getaffinity(0))


def local_shares(arguments):
    """Options that share this machine's cores and memory out among those who work in a local cluster."""
    if arguments.scheduler or arguments.scheduler_file:
        return []
    from distributed.system import MEMORY_LIMIT
    workers = local_workers(arguments)
    shares = {"--threads": max(1, len(os.sched_getaffinity(0)) // workers),
              "--memory-limit-gb": round(MEMORY_LIMIT / 4e9 / workers, 3)}
    given = {option.partition("=")[0] for option in arguments.options}
    return [word for name, share in shares.items() if name not in given for word in (name, str(share))]


def submit(client, tasks, arguments, resources, program):
    """Futures of all tasks."""
    options = [option for option in arguments.options if option != "--overwrite"]
    command = [program, arguments.scene, arguments.output, *options, "--quiet"]
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
            resources=resources or None))
    return futures


def without_images(options):
    """--images of the whole run is in the plan: tasks have their own."""
    kept, skip = [], False
    for option in options:
        if skip or option.startswith("--images="):
            skip = False
        elif option == "--images":
            skip = True
        else:
            kept.append(option)
    return kept


def duration(seconds):
    seconds = round(seconds)
    hours, minutes = seconds // 3600, seconds // 60 % 60
    return f"{hours}:{minutes:02d}:{seconds % 60:02d}" if hours else f"{minutes}:{seconds % 60:02d}"


def watch(futures, quiet):
    """Waits for all, reporting progress. Raises what a task raised."""
    from distributed import as_completed
    begin, shown = time.monotonic(), -1
    for done, future in enumerate(as_completed(futures), 1):
        future.result()
        percent = 100 * done // len(futures)
        if percent > shown and not quiet:
            shown = percent
            elapsed = time.monotonic() - begin
            left = duration(elapsed / done * (len(futures) - done))
            print(f"{percent:3d} % of {len(futures)} tasks, {left} left", file=sys.stderr, flush=True)


def main():
    arguments, parser = parse_arguments()
    resources = parse_resources(arguments.resources, parser)
    try:
        import distributed  # noqa: F401
    except ImportError:
        parser.error("needs Dask distributed (Debian: python3-distributed)")
    local = not (arguments.scheduler or arguments.scheduler_file)
    program = shutil.which(arguments.program) or arguments.program
    if not shutil.which(program):
        parser.error(f"--program {arguments.program}: not found")
    tasks = make_plan(program, arguments)
    if tasks is None:
        return EXIT_DONE
    arguments.options = without_images(arguments.options)
    client, cluster = connect(arguments, resources)
    try:
        if not arguments.quiet:
            print(f"dashboard: {client.dashboard_link}", file=sys.stderr, flush=True)
        watch(submit(client, tasks, arguments, resources, program if local else arguments.program), arguments.quiet)
    except StageError as error:
        print(f"acmp_cluster.py: {error}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        print("acmp_cluster.py: interrupted; the same command goes on from here", file=sys.stderr)
        return EXIT_FAILED
    finally:
        client.close()
        if cluster:
            cluster.close()
    if not arguments.quiet:
        print(f"{arguments.output}: done")
    return EXIT_DONE


if __name__ == "__main__":
    sys.exit(main())
