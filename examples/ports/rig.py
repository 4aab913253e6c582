"""A mass on a spring in real time, at the far end of rig.port.toml: it answers whoever sends it a force."""

import socket
import struct
import time

rig = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
rig.bind(("127.0.0.1", 9105))
rig.setblocking(False)
print("ready", flush=True)

position_m = velocity_mps = force_n = 0.0
port, count, done, begin = None, 0, 0, time.monotonic()
while True:
    try:
        while True:
            data, port = rig.recvfrom(64)
            _, force_n = struct.unpack("<Bd", data)
    except OSError:  # nothing more has arrived
        pass
    while done < 1000 * (time.monotonic() - begin):
        velocity_mps += 1e-3 * (force_n - 2.0 * velocity_mps - 100.0 * position_m)
        position_m += 1e-3 * velocity_mps
        done += 1
    if port is not None:
        rig.sendto(struct.pack("<Bdd", count % 256, position_m, velocity_mps), port)
        count += 1
    time.sleep(0.005)
