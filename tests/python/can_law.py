"""PID loop behind cannelloni, written from the page on ports with cantools alone.

    python can_law.py DBC PORT

Frames are taken from datagrams and put into them by can-cannelloni, signals by cantools, checksums by crccheck. Each
datagram that it sends has two frames that concern nobody around that of the command: another identifier and a remote
request. `frames.jsonl` gets a line of each received and sent frame with the values that cantools decodes from its bytes.
"""

import json
import socket
import sys

import can
import cantools
from can_cannelloni.protocol import decode_stream, encode_frames
from crccheck.crc import Crc8Base

PERIOD_S = 0.001
K_P, K_I, K_D = 300.0, 2000.0, 30.0


class SaeJ1850(Crc8Base):
    """CRC-8/SAE-J1850 of the catalogue, by its parameters."""

    _poly, _initvalue, _xor_output, _reflect_input, _reflect_output = 0x1D, 0xFF, 0xFF, False, False


assert SaeJ1850.calc(b"123456789") == 0x4B


def is_intact(data):
    """Returns `True` if the last byte is the sum of those before."""
    return SaeJ1850.calc(data[:-1]) == data[-1]


def main(dbc, port):
    database = cantools.database.load_file(dbc, strict=True)
    motion, drive = (database.get_message_by_name(name) for name in ("Motion", "Drive"))
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wire.bind(("127.0.0.1", int(port)))
    frames = open("frames.jsonl", "w", buffering=1, encoding="utf-8")
    print("ready", flush=True)
    integral, last, count = 0.0, None, 0
    while True:
        datagram, sender = wire.recvfrom(2048)
        version, code, sequence = datagram[:3]
        assert (version, code, sequence) == (2, 0, count % 256), datagram.hex()
        consumed, messages = decode_stream(bytearray(datagram[5:]))
        assert consumed == len(datagram) - 5 and len(messages) == int.from_bytes(datagram[3:5], "big") == 1
        (message,) = messages
        assert (message.arbitration_id, message.is_extended_id) == (motion.frame_id, motion.is_extended_frame)
        assert is_intact(message.data), message.data.hex()
        sample = motion.decode(message.data)
        assert sample["Alive"] == count % 16, (sample, count)
        assert sample["Spare"] == 0
        frames.write(json.dumps(["Motion", sample]) + "\n")

        error = sample["Target"] - sample["Position"]
        rate = 0.0
        if last is not None:
            integral += 0.5 * (error + last) * PERIOD_S
            rate = (error - last) / PERIOD_S
        last = error
        force_n = K_P * error + K_D * rate + K_I * integral
        data = bytearray(drive.encode({"Force": force_n, "Alive": count % 16, "Sum": 0}))
        data[-1] = SaeJ1850.calc(data[:-1])
        assert is_intact(data)
        frames.write(json.dumps(["Drive", drive.decode(data)]) + "\n")
        answers = [
            can.Message(arbitration_id=drive.frame_id, is_extended_id=False, data=b"\1\2\3\4"),
            can.Message(arbitration_id=drive.frame_id, is_extended_id=True, data=data),
            can.Message(arbitration_id=drive.frame_id, is_extended_id=True, is_remote_frame=True),
        ]
        header = bytes([2, 0, count % 256]) + len(answers).to_bytes(2, "big")
        wire.sendto(header + encode_frames(answers), sender)
        count += 1


if __name__ == "__main__":
    main(*sys.argv[1:])
