"""Strike a patch that another program plays, over Open Sound Control.

Start the player in one terminal, and this in another:

    uv run --extra osc fdh play piano_c4 --osc 9000
    uv run --extra osc python docs/examples/osc_from_another_program.py [PORT [SECONDS]]

Any program that sends OSC over UDP can do the same; docs/live.md lists all messages. SECONDS is the time between two
strikes.
"""

import sys
import time

from pythonosc.udp_client import SimpleUDPClient

port = int(sys.argv[1]) if len(sys.argv) > 1 else 9000
pause = float(sys.argv[2]) if len(sys.argv) > 2 else 0.5
client = SimpleUDPClient("127.0.0.1", port)

for velocity in (0.5, 1.0, 2.0, 4.0):  # m/s: a crescendo
    client.send_message("/strike", ["hammer", velocity])
    print(f"/strike hammer {velocity} m/s")
    time.sleep(pause)
client.send_message("/damp", "string")
