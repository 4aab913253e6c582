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
from typing import Callable, Deque, Iterable, Iterator, Optional, TypeVar

# Times of the first and last message, length and checksum of the content, length of the codec's name.
CHUNK = struct.Struct("<QQQII")
LENGTH = struct.Struct("<Q")
# A frame of LZ4 that `hil` writes: head, size of its only block, that block, end.
FRAME_HEAD = bytes.fromhex("04224d18607073")
BLOCK = struct.Struct("<I")
FRAME_END = bytes(4)
# Largest ratio of content to compressed bytes.
MOST_TIMES = 255
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
        import lz4.block
        import lz4.frame

        block = only_block(packed)
        content: bytes
        if block is not None and length <= MOST_TIMES * len(block):
            # At once into place: a frame is unpacked through buffers, which takes nearly twice as long.
            try:
                content = lz4.block.decompress(block, uncompressed_size=length)
            except lz4.block.LZ4BlockError as error:
                raise ChunkError(str(error)) from error
            return content
        try:
            content = lz4.frame.decompress(packed)
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


def only_block(frame: memoryview) -> Optional[memoryview]:
    """Returns the block of a frame that `hil` wrote; `None` of any other frame."""
    begin = len(FRAME_HEAD) + BLOCK.size
    if len(frame) < begin + len(FRAME_END) or frame[: len(FRAME_HEAD)] != FRAME_HEAD or frame[-len(FRAME_END) :] != FRAME_END:
        return None
    block = frame[begin : -len(FRAME_END)]
    return block if BLOCK.unpack_from(frame, len(FRAME_HEAD))[0] == len(block) else None


def thread_count() -> int:
    """Returns the number of threads that a recording is read with."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(MOST_THREADS, cores)


def in_parallel(work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Yields the results of all items in order, computed by some threads shortly before they are needed."""
    threads = thread_count()
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
