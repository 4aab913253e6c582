"""The file of a run: what is where in it, and its records as blocks of words.

Used by `result`. Knows what a recording says of itself and nothing of plants or controllers. A file whose
writer was killed is read as far as it goes; one that is damaged is refused.

A record is a message of 4 bytes of CDR encapsulation and 64-bit words, which the `ros2msg` schema names
one by one. All records of a run are of one length, so the records of a chunk are a table already: they
are viewed through one array, not taken apart one by one.
"""

from __future__ import annotations

import json
import os
import struct
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Callable, Dict, Iterator, List, NamedTuple, Optional, Tuple, Union

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from numpy.typing import NDArray

from .chunks import ChunkError, content_of, in_parallel, thread_count
from .errors import ProgramError, RecordingError
from .native import native

MAGIC = b"\x89MCAP0\r\n"
# Opcode and length of a record of the file.
HEAD = struct.Struct("<BQ")
# Channel, sequence, log time and publish time of a message.
MESSAGE = struct.Struct("<HIQQ")
# Channel of an index, and the length of its list.
INDEX = struct.Struct("<HI")
ENCAPSULATION_BYTES = 4
RULER = "=" * 80

Words = NDArray[np.uint64]


class Column(NamedTuple):
    """A word of a record; the unit is empty for what is no signal."""

    name: str
    unit: str

    @property
    def is_signal(self) -> bool:
        return "." in self.name


class ChunkPlace(NamedTuple):
    """Place of a chunk in the file, simulated time of its first and last message, and number of its records.

    The number is `None` if the chunk has no index.
    """

    offset: int
    length: int
    start_ns: int
    end_ns: int
    records: Optional[int] = None


class Recording:
    """A recording, of which everything but the records and events is in memory."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: Dict[str, Dict[str, str]] = {}
        self.attachments: Dict[str, str] = {}
        self.columns: List[Column] = []
        #: `True` if its writer finished it.
        self.is_whole = False
        self._chunks: List[ChunkPlace] = []
        self._schemas: Dict[int, str] = {}
        self._records_channel = -1
        self._events_channel = -1
        self._events_are_cdr = True
        with open(path, "rb") as file:
            if not MAGIC.startswith(file.read(len(MAGIC))):
                raise RecordingError(f"{path} is no MCAP file")
            self._index(file, os.fstat(file.fileno()).st_size)
        if not self.columns and not self.is_whole:
            raise RecordingError(f"{path} was cut off before its first record: nothing of the run is in it")
        if not self.columns:
            raise RecordingError(f"{path} is not a recording of a run: it has no channel `/record`")

    def _index(self, file: BinaryIO, size: int) -> None:
        while len(head := file.read(HEAD.size)) == HEAD.size:
            opcode, length = HEAD.unpack(head)
            offset = file.tell()
            if offset + length > size:
                return  # its writer was killed here
            if opcode == Opcode.DATA_END:
                self.is_whole = True
                return
            if opcode == Opcode.CHUNK:
                start_ns, end_ns = struct.unpack("<QQ", file.read(16))
                self._chunks.append(ChunkPlace(offset, length, start_ns, end_ns))
                if not self.columns:
                    # Other programs that write such files put channels in front of their messages.
                    self._take_channels(self._content(file, self._chunks[-1]))
            elif opcode == Opcode.MESSAGE_INDEX:
                channel, index_bytes = INDEX.unpack(file.read(INDEX.size))
                if self._chunks:
                    # Two words for each message. A list that is longer than its record matches no chunk.
                    listed = index_bytes // 16 if index_bytes <= length else 0
                    records = listed if channel == self._records_channel else self._chunks[-1].records or 0
                    self._chunks[-1] = self._chunks[-1]._replace(records=records)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.ATTACHMENT):
                self._take(opcode, file.read(length))
            file.seek(offset + length)

    def _take_channels(self, data: bytes) -> None:
        offset = 0
        while offset < len(data):
            opcode, length = HEAD.unpack_from(data, offset)
            offset += HEAD.size
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take(opcode, data[offset : offset + length])
            offset += length

    def _take(self, opcode: int, body: bytes) -> None:
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self._schemas[schema.id] = schema.data.decode()
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(stream)
            self.metadata[metadata.name] = dict(metadata.metadata)
        elif opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(stream)
            self.attachments[attachment.name] = attachment.data.decode()
        else:
            channel = Channel.read(stream)
            if channel.topic == "/record":
                self._records_channel = channel.id
                self.columns = columns_of(self._schemas.get(channel.schema_id, ""))
            elif channel.topic == "/events":
                self._events_channel = channel.id
                self._events_are_cdr = channel.message_encoding == "cdr"

    @property
    def rate_hz(self) -> float:
        try:
            return float(self.metadata["hil.run"]["rate_hz"])
        except (KeyError, ValueError):
            raise RecordingError(f"{self.path} does not say its rate") from None

    def blocks(self, wanted: Callable[[ChunkPlace], bool]) -> Iterator[Words]:
        """Yields the records of those chunks, in order: arrays with a row for each record.

        The arrays are views of the file's own bytes; what is to last has to be copied.
        """
        for blocks in in_parallel(lambda place: list(self._blocks(place)), filter(wanted, self._chunks)):
            yield from blocks

    def columns_of_all(self, places: List[int]) -> Optional[Words]:
        """Returns those words of all records, a row for each word; `None` if the file has no index of its chunks, or
        there is no native part to read it with.

        Each value is copied once, from the bytes of its chunk to its place in the result.
        """
        chunks = [(place.offset, place.length, place.records) for place in self._chunks]
        form = (self._records_channel, len(self.columns))
        try:
            if any(records is None for _, _, records in chunks):
                return None
            words = native().read_columns(self.path, form, places, chunks, thread_count())
        except ProgramError:
            return None
        if isinstance(words, tuple):
            number, reason = words
            at_s = self._chunks[number].start_ns / 1e9
            raise RecordingError(f"{self.path} is damaged after {at_s} s: {reason}")
        return np.ndarray((len(places), sum(records or 0 for _, _, records in chunks)), "<u8", words)

    def _blocks(self, place: ChunkPlace) -> Iterator[Words]:
        for content in self._messages(self._content_at(place)):
            if not isinstance(content, bytes):
                yield content

    def events(self) -> Iterator[Dict[str, Any]]:
        """Yields what happened, in order."""
        for content in self._contents(lambda place: True):
            if isinstance(content, bytes):
                yield json.loads(self._json(content))

    def _json(self, message: bytes) -> bytes:
        """Returns the facts of an event: the text that its message begins with, or in earlier files all of it."""
        if not self._events_are_cdr:
            return message
        (length,) = struct.unpack_from("<I", message, ENCAPSULATION_BYTES)
        begin = ENCAPSULATION_BYTES + 4
        return message[begin : begin + length - 1]

    def _contents(self, wanted: Callable[[ChunkPlace], bool]) -> Iterator[Union[Words, bytes]]:
        """Yields blocks of records, and events between them."""
        for place in filter(wanted, self._chunks):
            yield from self._messages(self._content_at(place))

    def _content_at(self, place: ChunkPlace) -> bytes:
        with open(self.path, "rb") as file:
            return self._content(file, place)

    def _content(self, file: BinaryIO, place: ChunkPlace) -> bytes:
        file.seek(place.offset)
        try:
            return content_of(file.read(place.length))
        except ChunkError as error:
            at_s = place.start_ns / 1e9
            raise RecordingError(f"{self.path} is damaged after {at_s} s: {error}") from error

    @cached_property
    def _form(self) -> Tuple[int, NDArray[np.uint8], int]:
        """Size of a record with its head, the bytes with which all of them begin, and the offset of the words."""
        words = HEAD.size + MESSAGE.size + ENCAPSULATION_BYTES
        size = words + 8 * len(self.columns)
        begins = HEAD.pack(Opcode.MESSAGE, size - HEAD.size) + struct.pack("<H", self._records_channel)
        return size, np.frombuffer(begins, np.uint8), words

    def _messages(self, data: bytes) -> Iterator[Union[Words, bytes]]:
        offset, (size, begins, words) = 0, self._form
        while offset < len(data):
            # As if nothing but records followed; what is another message ends the block.
            count = (len(data) - offset) // size
            is_record = np.ndarray((count, len(begins)), np.uint8, data, offset, (size, 1)) == begins
            if not is_record.all():
                count = int(is_record.all(axis=1).argmin())
            if count:
                yield np.ndarray((count, len(self.columns)), "<u8", data, offset + words, (size, 8))
                offset += count * size
                continue
            opcode, length = HEAD.unpack_from(data, offset)
            body = offset + HEAD.size
            if opcode == Opcode.MESSAGE:
                (channel, *_) = MESSAGE.unpack_from(data, body)
                if channel == self._records_channel:
                    raise RecordingError(f"{self.path}: a record of {length} bytes does not fit its schema")
                if channel == self._events_channel:
                    yield data[body + MESSAGE.size : body + length]
            offset = body + length


def columns_of(schema: str) -> List[Column]:
    """Returns the words of a record: `uint64`, arrays of it, arrays of two `uint32` for each word, messages of
    `float64`, and messages that are one word, taken apart for other programs."""
    top, *parts = schema.split(RULER)
    messages: Dict[str, List[Column]] = {}
    for part in parts:
        title, *lines = part.strip().splitlines()
        fields = [field_of(line) for line in lines if line.strip()]
        if all(kind == "float64" for kind, _, _ in fields):
            messages[title.removeprefix("MSG: ")] = [Column(name, unit) for _, name, unit in fields]
    columns: List[Column] = []
    for line in filter(str.strip, top.splitlines()):
        kind, name, _ = field_of(line)
        if kind in messages:
            columns += [Column(f"{name}.{field.name}", field.unit) for field in messages[kind]]
        elif kind.startswith(("uint64[", "uint32[")):
            words = int(kind[7:-1]) // (2 if kind.startswith("uint32") else 1)
            columns += [Column(f"{name}[{index}]", "") for index in range(words)]
        else:
            columns.append(Column(name, ""))
    return columns


def field_of(line: str) -> Tuple[str, str, str]:
    """Returns type, name and unit of a field: `float64 angle_rad # [rad] The angle.`"""
    field, _, comment = line.partition("#")
    kind, name = field.split()
    comment = comment.strip()
    unit = comment[1:].partition("]")[0] if comment.startswith("[") else ""
    return kind, name, unit
