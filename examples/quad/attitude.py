#!/usr/bin/env python3
"""Prints the attitude that Betaflight believes in: roll, pitch (nose up) and heading in degrees."""

import socket
import struct

ASK = b"$M<\x00\x6c\x6c"  # MSP_ATTITUDE, without data
HEAD = b"$M>\x06\x6c"


def attitude_deg(address=("127.0.0.1", 5761)):
    """Asks over the MultiWii serial protocol, on the port of Betaflight's first serial line."""
    with socket.create_connection(address, timeout=5) as line:
        line.sendall(ASK)
        answer = b""
        while HEAD not in answer or len(answer.partition(HEAD)[2]) < 7:
            part = line.recv(256)
            if not part:
                raise ConnectionError("Betaflight closed its serial line")
            answer += part
    data = answer.partition(HEAD)[2][:7]
    check = 0
    for byte in HEAD[3:] + data:
        check ^= byte
    if check:
        raise ValueError(f"the answer {answer!r} has another checksum")
    roll, pitch, heading = struct.unpack("<hhh", data[:6])
    # In 0.1 deg, 0.1 deg and 1 deg; its pitch is positive with the nose down.
    return roll / 10, -pitch / 10, heading


if __name__ == "__main__":
    print(*attitude_deg())
