"""Judges the codec of ports by cantools and python-can.

    python judge_codec.py FOLDER

FOLDER has `bus.dbc` and `packed.json`, frames as the codec packed them with the values that it reads back. Each is sent
over a virtual bus of python-can and decoded by cantools; any difference is an error. Then `encoded.json` is written: as
many frames that cantools made of random values, with the values that cantools reads back.
"""

import json
import pathlib
import random
import sys

import can
import cantools


def main() -> None:
    folder = pathlib.Path(sys.argv[1])
    database = cantools.database.load_file(folder / "bus.dbc", strict=True)
    packed = json.loads((folder / "packed.json").read_text())
    with can.Bus("judge", interface="virtual") as near, can.Bus(
        "judge", interface="virtual"
    ) as far:
        for frame in packed:
            data = bytes.fromhex(frame["data"])
            near.send(
                can.Message(
                    arbitration_id=frame["id"],
                    is_extended_id=frame["extended"],
                    is_fd=len(data) > 8,
                    data=data,
                )
            )
            message = far.recv(5.0)
            assert message is not None, "the virtual bus lost a frame"
            known = database.get_message_by_frame_id(message.arbitration_id)
            assert known.is_extended_frame == message.is_extended_id
            values = known.decode(bytes(message.data))
            for name, value in frame["values"].items():
                assert value == float(values[name]), (known.name, name, value, values[name])
            assert len(frame["values"]) == len(values), (frame, values)
    seeded = random.Random(49)
    encoded = []
    for _ in range(len(packed) // len(database.messages)):
        for message in database.messages:
            values = {}
            for signal in message.signals:
                if signal.conversion.is_float:
                    values[signal.name] = seeded.uniform(-1e6, 1e6)
                    continue
                low = -(1 << signal.length - 1) if signal.is_signed else 0
                raw = seeded.randrange(low, low + (1 << signal.length))
                # More than 52 digits are not exact as a float.
                raw = raw >> max(signal.length - 52, 0) << max(signal.length - 52, 0)
                value = raw * signal.scale + signal.offset
                if signal.minimum is not None:
                    value = min(max(value, signal.minimum), signal.maximum)
                values[signal.name] = value
            data = message.encode(values)
            decoded = message.decode(data)
            encoded.append(
                {
                    "message": message.name,
                    "data": data.hex(),
                    "values": {name: float(value) for name, value in decoded.items()},
                }
            )
    (folder / "encoded.json").write_text(json.dumps(encoded))


main()
