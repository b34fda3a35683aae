"""A process that forks nodes of the network: they begin at once, however busy the machine that loads numba.

Each line on its standard input is a JSON object: arguments of `noctule` and a file for what the node prints.
It answers with the pid. At the end of its input it kills those that are left.
"""

from __future__ import annotations

import json
import os
import signal
import sys

from noctule.cli import node_running  # noqa: F401 - loaded once for all
from noctule.cli.app import run
from noctule.cli.node_options import NodeOptions, prepare
from noctule.flight.network import drill, estimate_log, process, wire  # noqa: F401 - likewise


def main() -> None:
    prepare("fusion", NodeOptions(drill=0, drill_seconds=2.0))
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for them
    print("ready", flush=True)
    pids = []
    for line in sys.stdin:
        asked = json.loads(line)
        pid = os.fork()
        if pid == 0:
            out = os.open(asked["out"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(out, 1)
            os.dup2(os.open(asked["out"] + ".err", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            code = run(asked["arguments"])
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        pids.append(pid)
        print(pid, flush=True)
    for pid in pids:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            continue


if __name__ == "__main__":
    main()
