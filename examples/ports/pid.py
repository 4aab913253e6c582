"""A PID loop at the far end of a wire: answers each frame `sample` with a frame `force`."""

import socket
import struct

PERIOD_S = 0.001
K_P, K_I, K_D = 300.0, 2000.0, 30.0

wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.bind(("127.0.0.1", 9103))
print("ready", flush=True)
integral, last, count = 0.0, None, 0
while True:
    data, sender = wire.recvfrom(64)
    _, position_m, reference_m = struct.unpack("<Idd", data)
    error = reference_m - position_m
    rate = 0.0
    if last is not None:
        integral += 0.5 * (error + last) * PERIOD_S
        rate = (error - last) / PERIOD_S
    last = error
    force_n = K_P * error + K_D * rate + K_I * integral
    wire.sendto(struct.pack("<Id", count, force_n), sender)
    count += 1
