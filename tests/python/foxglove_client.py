"""A client of the Foxglove WebSocket protocol that shares no code with the server.

`foxglove_client.py URL SUBPROTOCOL FIELD` connects, subscribes to every channel and reads until the
server closes. Each line that it prints is JSON: what the server says in text, then each message with
its topic, log time and content, records decoded by the schema that the server gave.
"""

import json
import struct
import sys

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

MESSAGE_DATA = 1


def tell(**what):
    print(json.dumps(what), flush=True)


def main(url, subprotocol, path):
    decoders = {}
    topics = {}
    with connect(url, subprotocols=[subprotocol], open_timeout=60) as socket:
        tell(subprotocol=socket.subprotocol)
        while True:
            try:
                message = socket.recv(timeout=110)
            except ConnectionClosed:
                break
            if isinstance(message, str):
                said = json.loads(message)
                tell(said=said)
                if said["op"] != "advertise":
                    continue
                wanted = []
                for number, channel in enumerate(said["channels"]):
                    topics[number] = channel["topic"]
                    schema = Schema(
                        id=1,
                        name=channel["schemaName"],
                        encoding=channel["schemaEncoding"],
                        data=channel["schema"].encode(),
                    )
                    decoders[number] = DecoderFactory().decoder_for(channel["encoding"], schema)
                    wanted.append({"id": number, "channelId": channel["id"]})
                socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
                # Nothing that would change the run is taken.
                socket.send(json.dumps({"op": "setParameters", "parameters": []}))
                continue
            kind, subscription, log_time = struct.unpack_from("<BIQ", message)
            assert kind == MESSAGE_DATA, kind
            payload = message[13:]
            message = decoders[subscription](payload)
            if topics[subscription] == "/events":
                content = json.loads(message.json)
                assert content["event"] == message.event, message
            else:
                value = message
                for name in path.split("."):
                    value = getattr(value, name)
                content = {"step": message.step, "value": value}
            tell(topic=topics[subscription], log_time=log_time, content=content)
    tell(closed=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
