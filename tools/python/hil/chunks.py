"""Chunks of a recording: unpacked and checked, several at a time.

A chunk is compressed as a whole and carries a checksum of its content. Both are verified by code that lets other
threads run meanwhile, so that a whole recording is read at the speed of all cores.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Callable, Deque, Iterable, Iterator, TypeVar

# Times of the first and last message, length and checksum of the content, length of the codec's name.
CHUNK = struct.Struct("<QQQII")
LENGTH = struct.Struct("<Q")
#: More do not help: memory is the limit.
MOST_THREADS = 4

Item = TypeVar("Item")
Result = TypeVar("Result")


class ChunkError(Exception):
    """A chunk cannot be unpacked, or its checksum does not match."""


def content_of(body: bytes) -> bytes:
    """Returns the content of a chunk, unpacked and checked."""
    try:
        _, _, length, checksum, codec_length = CHUNK.unpack_from(body)
        begin = CHUNK.size + codec_length
        codec = body[CHUNK.size : begin]
        (packed_length,) = LENGTH.unpack_from(body, begin)
        packed = memoryview(body)[begin + LENGTH.size : begin + LENGTH.size + packed_length]
        content = unpack(codec, packed, length)
    except struct.error as error:
        raise ChunkError(str(error)) from error
    if len(content) != length:
        raise ChunkError(f"a chunk has {len(content)} bytes in place of {length}")
    if checksum != 0 and zlib.crc32(content) != checksum:
        raise ChunkError("the checksum of a chunk does not match")
    return content


def unpack(codec: bytes, packed: memoryview, length: int) -> bytes:
    """Decompresses the content of a chunk."""
    if codec == b"":
        return bytes(packed)
    if codec == b"lz4":
        import lz4.frame

        try:
            content: bytes = lz4.frame.decompress(packed)
        except RuntimeError as error:
            raise ChunkError(str(error)) from error
        return content
    if codec == b"zstd":
        import zstandard

        try:
            return zstandard.ZstdDecompressor().decompress(packed, max_output_size=length)
        except zstandard.ZstdError as error:
            raise ChunkError(str(error)) from error
    raise ChunkError(f"its compression `{codec.decode(errors='replace')}` is unknown")


def in_parallel(work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Yields the results of all items in order, computed by some threads shortly before they are needed."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    threads = min(MOST_THREADS, cores)
    if threads == 1:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        pending: Deque[Future[Result]] = deque()
        try:
            for item in items:
                pending.append(pool.submit(work, item))
                if len(pending) > 2 * threads:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()
