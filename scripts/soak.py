#!/usr/bin/env python3
"""See soak.sh. Usage: soak.py BUILD MINUTES"""
import os
import re
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from nodelet_session import Session, call, make_bag, play, save_map

# The map is full after the first loops: 14 keyframes each. What is kept of a run is then the same after each loop.
MAX_KEYFRAMES = 28
# Between the medians of the first and the last third after the warm-up. The allocator's free lists and the order of threads
# make single samples differ by 1 to 2 MiB; an image lost in each loop (64 x 48 px in colour, grey, planes and cost: 75 bytes
# a pixel) would be 0.2 MiB a loop.
MAX_GROWTH_MIB = 3.0
ROWS = 12


def sample(pid):
    status = Path(f"/proc/{pid}/status").read_text()
    resident = int(re.search(r"VmRSS:\s+(\d+) kB", status).group(1)) / 1024
    return resident, len(os.listdir(f"/proc/{pid}/fd")), int(re.search(r"Threads:\s+(\d+)", status).group(1))


def main():
    build, minutes = Path(sys.argv[1]), float(sys.argv[2])
    samples = []
    with tempfile.TemporaryDirectory() as folder, Session(folder, {"max_keyframes": MAX_KEYFRAMES}) as session:
        bag = make_bag(build, f"{folder}/room.bag")
        begin = time.monotonic()
        while time.monotonic() < begin + 60 * minutes:
            play(bag)
            if "success: True" not in call("/dense_mapper/flush") or not save_map(f"{folder}/map.ply")[0]:
                sys.exit(f"loop {len(samples)}: no map; the end of the log:\n{session.log()[-2000:]}")
            samples.append((time.monotonic() - begin, *sample(session.manager.pid)))
    print("| minutes | loops | memory [MiB] | handles | threads |\n|---|---|---|---|---|")
    shown = sorted({round(i * (len(samples) - 1) / (ROWS - 1)) for i in range(ROWS)})
    for i in shown:
        seconds, *values = samples[i]
        print("| {:.1f} | {} | {:.1f} | {} | {} |".format(seconds / 60, i + 1, *values))
    warm = samples[len(samples) // 4:]
    third = len(warm) // 3
    if third < 3:
        sys.exit(f"only {len(samples)} loops in {minutes:g} minutes: too few to see a trend")
    failures = []
    for column, name, bound in ((1, "memory [MiB]", MAX_GROWTH_MIB), (2, "handles", 0), (3, "threads", 0)):
        first, last = (median(row[column] for row in part) for part in (warm[:third], warm[-third:]))
        print(f"{name}: {first:.1f} in the first third after the warm-up, {last:.1f} in the last, {last - first:+.1f} in "
              f"{len(warm) - third} loops, at most {bound:+g}")
        if last - first > bound:
            failures.append(f"{name} grows")
    sys.exit("; ".join(failures) or 0)


if __name__ == "__main__":
    main()
