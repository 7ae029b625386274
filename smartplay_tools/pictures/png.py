"""PNG files that are the same to the byte on every platform: a writer for pictures made of enlarged pixels.

What `zlib` compresses depends on its version, so nothing here is compressed by it. A picture of a game has few pixels,
each of them repeated `scale` times in both directions, and that is all the compression that is needed. The data is one
deflate block whose Huffman code is chosen so that a pixel takes 32 bits: three literals of 9 bits, and a match that
repeats them. A row takes its pixels and a constant, the match that repeats the row, which ends on a whole byte. So a
file is a constant pattern with one table look-up for each pixel, and needs no loop. A picture may be made of tiles; the
pixels of one that stands in several places are looked up once.

Pictures whose pixels are not enlarged, or with rows too long to be repeated, are stored uncompressed.
"""

from __future__ import annotations

import functools
import itertools
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.pictures.picture import Picture

LARGEST_SCALE = 12
"""The largest factor: a match of more than 34 bytes does not fit into the 5 bits that a pixel has for it."""

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_ZLIB_HEADER = b"\x78\x01"
_ADLER = 65521
_LITERAL = 9
"""The bits of a byte."""
_END = 256
_LONGEST_MATCH = 258
_WINDOW = 32768
"""How far back a match can reach."""
_STORED = 65535
"""The most bytes of a stored block."""

_LENGTHS = (*range(3, 11), *range(11, 19, 2), *range(19, 35, 4), *range(35, 67, 8), *range(67, 131, 16))
_LENGTHS += (*range(131, 258, 32), 258)
_DISTANCES = (1, 2, *(1 + 2**bits + half * 2 ** (bits - 1) for bits in range(1, 15) for half in (0, 1)))
"""The smallest length and distance of each symbol of deflate (RFC 1951, 3.2.5)."""
_ORDER = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15]
"""The order in which a header lists the lengths of the codes for lengths of codes (3.2.7)."""

Pixel = TypeVar("Pixel", np.uint8, np.uint32)

Bits = list[tuple[int, int]]
"""Values and how many bits each has, lowest bit first."""


def encode(pixels: NDArray[np.uint8], scale: int) -> Picture:
    """Return the picture with every pixel enlarged to `scale` x `scale`.

    `pixels` are rows x columns x red, green and blue; `scale` is from 1 to `LARGEST_SCALE`.
    """
    return encode_tiles(pixels.transpose(2, 0, 1)[:, None], _ALONE, scale)


def encode_tiles(tiles: NDArray[np.uint8], places: NDArray[np.intp], scale: int) -> Picture:
    """Return the picture that tiles make, as `encode` would; one that stands in several places is encoded once.

    `tiles` are planes (red, green, blue) of tiles of rows x columns, and `places` has the number of the tile that
    stands in each row and column of them.
    """
    rows, columns = places.shape[0] * tiles.shape[2], places.shape[1] * tiles.shape[3]
    width, height = columns * scale, rows * scale
    if not 1 <= scale <= LARGEST_SCALE:
        raise InvalidArgumentError(f"A picture is enlarged 1 to {LARGEST_SCALE} times, not {scale}.")
    is_stored = scale == 1 or 1 + 3 * width > _WINDOW
    data = (
        _stored(joined_tiles(tiles, places).transpose(1, 2, 0).repeat(scale, 0).repeat(scale, 1))
        if is_stored
        else _layout(rows, columns, scale).data(tiles, places)
    )
    return Picture(b"".join((_beginning(width, height), _chunk(b"IDAT", data), _IEND)), width, height)


def joined_tiles(tiles: NDArray[Pixel], places: NDArray[np.intp]) -> NDArray[Pixel]:
    """Return the planes of the picture that tiles make: ... x rows x columns."""
    *planes, _, rows, columns = tiles.shape
    down, across = places.shape
    laid = tiles.take(places, axis=-3).swapaxes(-3, -2)
    return laid.reshape(*planes, down * rows, across * columns)


_ALONE = np.zeros((1, 1), np.intp)
"""The place of a tile that is a whole picture."""


@functools.lru_cache(16)
def _beginning(width: int, height: int) -> bytes:
    return _SIGNATURE + _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))


def _chunk(kind: bytes, data: bytes) -> bytes:
    return b"".join((struct.pack(">I", len(data)), kind, data, struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))))


_IEND = _chunk(b"IEND", b"")


def _stored(pixels: NDArray[np.uint8]) -> bytes:
    """The zlib stream of a picture in stored blocks."""
    rows, columns, _ = pixels.shape
    lines = np.zeros((rows, 1 + 3 * columns), np.uint8)
    lines[:, 1:] = pixels.reshape(rows, -1)
    raw = lines.tobytes()
    parts = [_ZLIB_HEADER]
    for at in range(0, len(raw), _STORED):
        block = raw[at : at + _STORED]
        parts += [struct.pack("<BHH", at + _STORED >= len(raw), len(block), len(block) ^ 0xFFFF), block]
    return b"".join((*parts, struct.pack(">I", zlib.adler32(raw))))


@dataclass(frozen=True)
class _Layout:
    """The stream of every picture of a size: a pattern of bytes, and where the words of its pixels go."""

    before: bytes
    pattern: NDArray[np.uint8]
    """Row by row, room for its pixels, and then the bits that are the same for each row."""
    joint: int
    """How many bytes these bits are."""
    after: bytes
    words: NDArray[np.uint32]
    """By channel and value: its part of a pixel's word."""
    scale: int
    length: int
    """The bytes of the picture as they are checked: rows of pixels with a zero before each."""

    def data(self, tiles: NDArray[np.uint8], places: NDArray[np.intp]) -> bytes:
        """Return the zlib stream of the picture that tiles make."""
        red, green, blue = self.words
        words = red.take(tiles[0])
        words |= green.take(tiles[1])
        words |= blue.take(tiles[2])
        filled = self.pattern.copy()
        pixels = joined_tiles(words, places).astype("<u4", copy=False)
        filled[:, : 4 * pixels.shape[1]] = pixels.view(np.uint8)
        body = filled.ravel()[: -self.joint].tobytes()
        return b"".join((self.before, body, self.after, struct.pack(">I", self.checksum(tiles, places))))

    def checksum(self, tiles: NDArray[np.uint8], places: NDArray[np.intp]) -> int:
        """Return Adler-32 of the enlarged picture, from sums over its tiles.

        Its second sum has each byte as often as there are bytes from it to the end. The sums are whole numbers, far
        below 2**53, so floats have them exactly.
        """
        _, number, rows, columns = tiles.shape
        inside = tiles.reshape(3, number, -1).astype(np.float64) @ _inside(rows, columns)
        where = (places.ravel() + np.array([[0], [number], [2 * number]])).ravel()
        standing = np.bincount(where, _weights(*places.shape), 3 * number).reshape(3, number)
        # By colour: the sum of each tile, and those by row and column, times how often, in which row and column it is.
        sums = np.rint(standing @ inside).astype(np.int64).tolist()
        total = sum(colour[0][0] for colour in sums)
        by_row = sum(rows * colour[1][0] + colour[0][1] for colour in sums)
        by_column = sum(columns * colour[2][0] + colour[0][2] for colour in sums)
        scale, copies = self.scale, self.scale * self.scale
        row = self.length // (scale * rows * places.shape[0])
        enlarged = total * copies * (scale - 1) // 2
        down, across = copies * by_row * scale + enlarged, copies * by_column * scale + enlarged
        colour = copies * (sums[1][0][0] + 2 * sums[2][0][0])
        second = self.length + (self.length - 1) * copies * total - row * down - 3 * across - colour
        return int(second % _ADLER << 16 | (1 + copies * total) % _ADLER)


@functools.lru_cache(16)
def _inside(rows: int, columns: int) -> NDArray[np.float64]:
    """By pixel of a tile: 1, its row, its column."""
    down, across = np.divmod(np.arange(rows * columns), columns)
    return np.stack([np.ones(rows * columns), down, across], axis=1)


@functools.lru_cache(16)
def _weights(rows: int, columns: int) -> NDArray[np.float64]:
    """1 for every place of a tile, then the rows, then the columns."""
    return np.ascontiguousarray(_inside(rows, columns).T).ravel()


@functools.lru_cache(16)
def _layout(rows: int, columns: int, scale: int) -> _Layout:
    code = _code(columns, scale)
    row = 1 + 3 * columns * scale
    before = _pack([*code.header, code.literals[0]])
    pattern = np.zeros((rows, 4 * columns + code.joint_bits // 8), np.uint8)
    pattern[:, 4 * columns :] = np.frombuffer(_pack([*code.repeat_row, code.literals[0]]), np.uint8)
    repeat, used = _joined(code.repeat_pixel)
    values = np.array([value for value, _ in code.literals], np.uint32)
    words = np.stack([values, values << _LITERAL, values << 2 * _LITERAL | repeat << 3 * _LITERAL])
    assert used + 3 * _LITERAL == 32
    return _Layout(
        before=_ZLIB_HEADER + before,
        pattern=pattern,
        joint=code.joint_bits // 8,
        after=_pack([*code.repeat_row, code.end]),
        words=words,
        scale=scale,
        length=rows * scale * row,
    )


@dataclass(frozen=True)
class _Code:
    """A Huffman code under which the pixels of a picture begin on whole bytes, and its header."""

    header: Bits
    literals: Bits
    repeat_pixel: Bits
    """The match that repeats a pixel."""
    repeat_row: Bits
    """The matches that repeat a row."""
    end: tuple[int, int]

    @property
    def joint_bits(self) -> int:
        """The bits from the end of a row's pixels to the beginning of the next row's."""
        return _count(self.repeat_row) + _LITERAL


def _code(columns: int, scale: int) -> _Code:
    """Return the first code, in a fixed order of trying, under which everything ends where it has to."""
    row = 1 + 3 * columns * scale
    pixel, near, far = _symbol(_LENGTHS, 3 * (scale - 1)), _symbol(_DISTANCES, 3), _symbol(_DISTANCES, row)
    distances = _huffman({near[0]: 1, far[0]: 1})
    fewest = -(-(scale - 1) * row // _LONGEST_MATCH)
    for count in range(fewest, fewest + 16):
        matches = [_symbol(_LENGTHS, length) for length in _matches((scale - 1) * row, count)]
        symbols = sorted({number for number, _, _ in matches} - {pixel[0]})
        for lengths in itertools.product(range(3, 13), repeat=1 + len(symbols)):
            chosen = {257 + pixel[0]: 4 - pixel[2], _END: lengths[0]}
            chosen |= {257 + symbol: bits for symbol, bits in zip(symbols, lengths[1:], strict=True)}
            bits = sum(chosen[257 + number] + more + 1 + far[2] for number, _, more in matches)
            completed = _completed(chosen)
            if (bits + _LITERAL) % 8 or completed is None:
                continue
            codes = _huffman(completed)
            repeat_row = [bits for match in matches for bits in _match(codes, distances, match, far)]
            header = _header(completed, {near[0], far[0]})
            if header is not None:
                repeat_pixel = _match(codes, distances, pixel, near)
                return _Code(header, [codes[value] for value in range(256)], repeat_pixel, repeat_row, codes[_END])
    raise AssertionError(f"there is no code for {columns} pixels, enlarged {scale} times")


def _matches(total: int, count: int) -> Iterator[int]:
    """Cut a length into `count` matches that are nearly equal, since a match has at least 3 bytes."""
    for number in range(count):
        yield total // count + (number < total % count)


def _symbol(table: Sequence[int], value: int) -> tuple[int, int, int]:
    """Return the symbol for a length or a distance: its number in its table, its further bits, and how many."""
    number = max(at for at, least in enumerate(table) if least <= value)
    most = table[number + 1] if number + 1 < len(table) else table[number] + 1
    if table is _LENGTHS and number == len(table) - 2:
        most += 1  # 258 has a symbol of its own, but the one before would reach it, too
    return number, value - table[number], (most - table[number] - 1).bit_length()


def _match(
    codes: Mapping[int, tuple[int, int]],
    distances: Mapping[int, tuple[int, int]],
    length: tuple[int, int, int],
    distance: tuple[int, int, int],
) -> Bits:
    return [codes[257 + length[0]], length[1:], distances[distance[0]], distance[1:]]


def _completed(chosen: Mapping[int, int]) -> dict[int, int] | None:
    """Return the lengths of all codes: of bytes, of the chosen symbols, and of others that use up what is left."""
    left = (1 << 15) - (256 << 15 - _LITERAL) - sum(1 << 15 - bits for bits in chosen.values())
    if left < 0:
        return None
    unused = (symbol for symbol in range(257, 286) if symbol not in chosen)
    fillers = {next(unused): bits for bits in range(1, 16) if left & 1 << 15 - bits}
    return dict.fromkeys(range(256), _LITERAL) | dict(chosen) | fillers


def _huffman(lengths: Mapping[int, int]) -> dict[int, tuple[int, int]]:
    """Return the canonical codes for these lengths (3.2.2), each with its lowest bit first."""
    codes: dict[int, tuple[int, int]] = {}
    code = before = 0
    for bits, symbol in sorted((bits, symbol) for symbol, bits in lengths.items()):
        code <<= bits - before
        codes[symbol] = int(f"{code:0{bits}b}"[::-1], 2), bits
        code, before = code + 1, bits
    return codes


def _header(lengths: Mapping[int, int], distances: set[int]) -> Bits | None:
    """Return the beginning of the block, up to its first symbol; None if the first pixel is not on a whole byte."""
    headers = (_header_from(lengths, distances, first) for first in range(len(_ORDER)))
    return next((header for header in headers if (_count(header) + _LITERAL) % 8 == 0), None)


def _header_from(lengths: Mapping[int, int], distances: set[int], first: int) -> Bits:
    """Return a beginning. Its codes for the lengths of codes have 4 bits, and six of them, from `first` on, have 5."""
    longer = {(first + number) % len(_ORDER) for number in range(6)}
    of_lengths = {symbol: 4 + (symbol in longer) for symbol in range(len(_ORDER))}
    codes = _huffman(of_lengths)
    repeat, six = codes[16], (3, 2)
    # 256 codes of the same length: the first, 42 times six more, and three more.
    bits: Bits = [(1, 1), (2, 2), (286 - 257, 5), (max(distances), 5), (len(_ORDER) - 4, 4)]
    bits += [(of_lengths[symbol], 3) for symbol in _ORDER]
    bits += [codes[_LITERAL], *[repeat, six] * 42, repeat, (0, 2)]
    bits += [codes[lengths.get(symbol, 0)] for symbol in range(256, 286)]
    bits += [codes[int(symbol in distances)] for symbol in range(max(distances) + 1)]
    return bits


def _count(bits: Bits) -> int:
    return sum(count for _, count in bits)


def _joined(bits: Bits) -> tuple[int, int]:
    value = used = 0
    for part, count in bits:
        value |= part << used
        used += count
    return value, used


def _pack(bits: Bits) -> bytes:
    value, used = _joined(bits)
    return value.to_bytes(-(-used // 8), "little")
