#!/usr/bin/env python3
"""The ROS master is killed while mapper and map are loaded, and another one started: the map must be kept, found and
extended. Usage: master_restart_test.py SOURCE_FOLDER"""
import os
import signal
import subprocess
import sys
import tempfile
import xmlrpc.client
from pathlib import Path

sys.path.insert(0, str(Path(sys.argv[1]) / "scripts"))
from nodelet_session import (  # noqa: E402  pylint: disable=wrong-import-position
    Session, make_bag, save_map, start_master, wait_for)


def main():
    with tempfile.TemporaryDirectory() as folder, Session(folder) as session:
        bag = make_bag(f"{folder}/room.bag")
        first = session.map_bag(bag)
        # The watch reads what is registered every few seconds: it must have seen all of it once.
        wait_for(lambda: "/map_server/save_map" in subprocess.run(
            ["rosservice", "list"], stdout=subprocess.PIPE, text=True, check=True).stdout, "the services")
        session.master.kill()
        session.master.wait()
        wait_for(lambda: "cannot be reached" in session.log(), "the warning")
        # While it waits, another manager of the same name registers first.
        session.manager.send_signal(signal.SIGSTOP)
        session.master = start_master(int(os.environ["ROS_MASTER_URI"].rsplit(":", 1)[1]))
        master = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
        other = ("/manager", "/other_service", "rosrpc://localhost:1")
        master.registerService(*other, "http://localhost:1")
        session.manager.send_signal(signal.SIGCONT)
        wait_for(lambda: "another /manager has registered" in session.log(), "word of the other manager")
        master.unregisterService(*other)
        wait_for(lambda: "registered again" in session.log(), "registration")
        kept = save_map(f"{folder}/map.ply")[0]
        again = session.map_bag(bag)
        print(f"{first} points, {kept} after the restart, {again} after the bag was played again")
        failures = []
        if kept != first:
            failures.append("the map was not kept")
        # The same images again are keyframes of their own, matched in another order at the window's ends.
        if again < kept:
            failures.append("points were lost")
        if "time jumped back" not in session.log():
            failures.append("the second run's images did not arrive")
        if not session.alive():
            failures.append("the nodelets' manager has died")
        sys.exit("; ".join(failures) or 0)


if __name__ == "__main__":
    main()
