"""How often this machine wakes a thread late that has the priority of an audio thread: `stalls.py PERIOD LATE` counts
from its start to SIGINT, and prints the number of times and the longest, in ms."""

import json
import os
import signal
import sys
import time

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job would ignore it
    period, limit = float(sys.argv[1]), float(sys.argv[2])
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(60))
    count, longest, due = 0, 0.0, time.monotonic() + period
    try:
        while True:
            time.sleep(max(0.0, due - time.monotonic()))
            late = time.monotonic() - due
            count, longest, due = count + (late > limit), max(longest, late), max(due, time.monotonic()) + period
    except KeyboardInterrupt:
        print(json.dumps({"count": count, "longest": 1000.0 * longest}))
