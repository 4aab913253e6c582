"""Reads recordings with rosbags and compares every message with a table of `hil export`, bit by bit.

    python compare_rosbags.py RUN.mcap TABLE.csv [RUN.mcap TABLE.csv]..

rosbags reads recordings of ROS 2 without ROS and takes nothing else. Checks that every channel is one that
it knows, names, values and times of all records, and that the fields of every event are what its JSON says.
Ends with 0 when all holds.
"""

import json
import struct
import sys

import pandas
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

FIELDS = "__dataclass_fields__"


def bits(number):
    return struct.pack("<d", number)


def check_event(message):
    """Every field is what the JSON has under its name; 0, false or empty where it has nothing."""
    facts = json.loads(message.json)
    assert facts["event"], facts
    for name in getattr(message, FIELDS):
        if name not in ("json", "__msgtype__"):
            assert (getattr(message, name) or None) == (facts.get(name) or None), f"{name} of {facts}"


def signals(message):
    """Names and values of the signals of a record."""
    for group in getattr(message, FIELDS):
        fields = getattr(message, group)
        for name in getattr(fields, FIELDS, ()):
            value = getattr(fields, name)
            if isinstance(value, float):
                yield f"{group}.{name}", value


def compare(recording, table):
    expected = pandas.read_csv(table, dtype={"step": "uint64"}).to_dict("list")
    columns = {name for name in expected if "." in name}
    records, events = 0, 0
    with Reader(recording) as reader:
        types = get_typestore(Stores.EMPTY)
        for connection in reader.connections:
            types.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for connection, time_ns, data in reader.messages():
            message = types.deserialize_cdr(data, connection.msgtype)
            if connection.topic == "/events":
                check_event(message)
                events += 1
                continue
            assert connection.topic == "/record", connection.topic
            assert message.step == expected["step"][records]
            assert message.time_ns == time_ns and time_ns / 1e9 == expected["time_s"][records]
            found = {name: value for name, value in signals(message) if name in columns}
            assert found.keys() == columns, columns ^ found.keys()
            for name, value in found.items():
                assert bits(value) == bits(expected[name][records]), f"{name} at step {message.step}"
            records += 1
        assert records + events == reader.message_count, reader.message_count
    assert records == len(expected["step"]), f"{records} of {len(expected['step'])} records"
    print(f"{records} records and {events} events, the same bits in rosbags")


if __name__ == "__main__":
    words = sys.argv[1:]
    for recording, table in zip(words[::2], words[1::2]):
        compare(recording, table)
