# SPDX-License-Identifier: Apache-2.0
"""What rosbag2 has compressed: whole files, or the bytes of each message.

zstandard and lz4 come with ``mcap``. Compressed data are known by their first bytes: no CDR
message begins as they do, and a file loses its metadata.yaml easily.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import tempfile
from typing import Any, IO

from adaptive_blf_control.errors import BagError

__all__ = ['PACKED_SUFFIXES', 'is_packed', 'unpack_bounded', 'unpack_file',
           'unpack_message']

PACKED_SUFFIXES = ('.zstd', '.zst', '.lz4')
_ZSTD, _LZ4 = b'\x28\xb5\x2f\xfd', b'\x04\x22\x4d\x18'
_LARGEST = 1 << 28  # bytes of one message
_LARGEST_FILE = 1 << 40  # bytes
_LARGEST_RATIO = 200  # of an unpacked file to the packed one, beyond the first gigabyte
_BLOCK = 1 << 20  # bytes


def is_packed(start: bytes) -> bool:
    """Return whether data that begin so are a zstd or lz4 frame."""
    return start.startswith((_ZSTD, _LZ4))


def unpack_message(data: bytes) -> bytes:
    """Return the bytes of a compressed message; one that is not compressed stays as it is.

    Raises:
        BagError: the frame is damaged.
    """
    if not is_packed(data):
        return data
    try:
        return unpack_bounded(data, 'zstd' if data.startswith(_ZSTD) else 'lz4', _LARGEST)
    except BagError as exc:
        raise BagError(f'message cannot be decompressed: {exc}') from exc


def unpack_bounded(data: bytes, compression: str, largest: int) -> bytes:
    """Return what zstd or lz4 data stand for; BagError where it is more than ``largest`` bytes."""
    # Imported here because bags of this package are not compressed.
    if compression == 'zstd':
        import zstandard
        try:
            if zstandard.frame_content_size(data) > largest:
                raise BagError(f'it stands for more than {largest} bytes')
            unpacked = zstandard.ZstdDecompressor().decompress(data, max_output_size=largest)
        except zstandard.ZstdError as exc:
            raise BagError(str(exc)) from exc
    else:
        from lz4 import frame
        try:
            unpacked = frame.LZ4FrameDecompressor().decompress(data, max_length=largest + 1)
        except (RuntimeError, EOFError) as exc:
            raise BagError(str(exc)) from exc
    if len(unpacked) > largest:
        raise BagError(f'it stands for more than {largest} bytes')
    return bytes(unpacked)


def unpack_file(path: Path) -> IO[bytes]:
    """Return a temporary file with the content of a compressed one; closing it deletes it.

    A file that breaks off is unpacked up to the break.

    Raises:
        BagError: it cannot be read, or there is no room for its content.
    """
    try:
        unpacked: IO[bytes] = tempfile.NamedTemporaryFile(  # noqa: SIM115 (the caller closes it)
            prefix='adaptive_blf_control_', suffix=path.with_suffix('').suffix)
        with path.open('rb') as stream:
            room = min((1 << 30) + _LARGEST_RATIO * path.stat().st_size, _LARGEST_FILE)
            for block in _blocks(stream):
                unpacked.write(block)
                room -= len(block)
                if room < 0:
                    raise BagError(f'{path}: cannot be unpacked: it stands for far more than a '
                                   'recording of its size')
        unpacked.flush()
    except OSError as exc:
        raise BagError(f'{path}: cannot be unpacked: {exc.strerror or exc}') from exc
    return unpacked


def _blocks(stream: IO[bytes]) -> Iterator[bytes]:
    """Yield the content of a compressed stream, up to where it breaks off."""
    start = stream.read(len(_ZSTD))
    stream.seek(0)
    reader: Any
    broken: tuple[type[Exception], ...]
    if start == _ZSTD:
        import zstandard
        reader, broken = zstandard.ZstdDecompressor().stream_reader(
            stream, read_across_frames=True), (zstandard.ZstdError, EOFError)
    else:
        from lz4 import frame
        reader, broken = frame.open(stream), (RuntimeError, EOFError)
    try:
        while block := reader.read(_BLOCK):
            yield block
    except broken:
        return
