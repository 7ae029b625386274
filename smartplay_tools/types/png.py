"""PNG files that are the same to the byte on every platform: a writer for pictures made of enlarged pixels.

What `zlib` compresses depends on its version, so nothing here is compressed by it. A picture of a game has few pixels,
each of them repeated `scale` times in both directions, and that is all the compression that is needed. The data is one
deflate block whose Huffman code is chosen so that a pixel takes 32 bits: three literals of 9 bits, and a match that
repeats them. A row takes its pixels and a constant, the match that repeats the row, which ends on a whole byte. So a
tile is the same bytes wherever it stands in a picture: pictures are put together from encoded tiles, which can be kept
and used again.

Pictures whose pixels are not enlarged, or with rows too long to be repeated, are stored uncompressed.
"""

from __future__ import annotations

import functools
import itertools
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types.pictures import Picture

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

Bits = list[tuple[int, int]]
"""Values and how many bits each has, lowest bit first."""


def encode(pixels: NDArray[np.uint8], scale: int) -> Picture:
    """Return the picture with every pixel enlarged to `scale` x `scale`.

    `pixels` are rows x columns x red, green and blue; `scale` is from 1 to `LARGEST_SCALE`.
    """
    layout = layout_of(1, 1, *pixels.shape[:2], scale)
    return layout.picture(layout.blank, layout.encoded(pixels.transpose(2, 0, 1)[None]))


class EncodedTiles(NamedTuple):
    """Encoded tiles of a layout: the bytes of a tile are the same wherever it stands in a picture."""

    lines: NDArray[np.void]
    """The bytes of each tile's rows of pixels: tiles x rows."""
    sums: NDArray[np.int64]
    """How much each adds to the two sums of the picture's Adler-32 where it stands at the top left: tiles x 2."""

    def take(self, numbers: NDArray[np.uint8]) -> EncodedTiles:
        """Return tiles by their numbers among these."""
        return EncodedTiles(self.lines.take(numbers, 0), self.sums.take(numbers, 0))


class Canvas(NamedTuple):
    """The lines of a picture, some of whose tiles may be missing."""

    lines: bytes
    """The bytes from the beginning of the data to the last row of pixels."""
    first: int
    """How much its tiles add to the first sum of the picture's Adler-32."""
    second: int
    """How much they add to the second sum."""


class Layout:
    """Pictures of one size, made of tiles of one size."""

    def __init__(self, down: int, across: int, rows: int, columns: int, scale: int) -> None:
        self._across, self._scale = across, scale
        self._width, self._height = across * columns * scale, down * rows * scale
        self._beginning = _beginning(self._width, self._height)
        line = 1 + 3 * self._width
        self._length = self._height * line
        self._tile_row = rows * scale * line
        row, column = np.divmod(np.arange(down * across), across)
        less = row * rows * scale * line + column * 3 * columns * scale
        weights = np.ones_like(less), -less, np.zeros_like(less), np.ones_like(less)
        self._weights = np.stack(weights, axis=1).reshape(-1, 2)
        """How often the two sums of each tile from the top left on count in the two sums of the picture."""

    def _lay_out(self, before: bytes, joint: bytes, wide: int, down: int, rows: int) -> None:
        """Set what is around the pixels: `joint` between their rows, each of whose tiles has `wide` bytes."""
        line = self._across * wide + len(joint)
        lines = before + (bytes(self._across * wide) + joint) * (down * rows)
        self.blank = Canvas(lines[: len(lines) - len(joint)], 0, 0)
        """A picture without tiles."""
        self._offset, self._rows, self._strides = len(before), rows, (rows * line, wide, line)
        self._tile_lines = np.dtype((np.void, wide))

    def encoded(self, tiles: NDArray[np.uint8]) -> EncodedTiles:
        """Return tiles, encoded; the array is tiles x red, green and blue x rows x columns."""
        raise NotImplementedError

    def begun(self, tiles: EncodedTiles, at: int) -> Canvas:
        """Return a canvas that has tiles from the row of tiles `at` on, and none above."""
        lines = bytearray(self.blank.lines)
        first, second = self._lay(lines, tiles, at)
        return Canvas(bytes(lines), first, second)

    def picture(self, canvas: Canvas, tiles: EncodedTiles) -> Picture:
        """Return the picture of a canvas and the tiles that it still lacks, in order from the top left."""
        lines = bytearray(canvas.lines)
        first, second = self._lay(lines, tiles, 0)
        chunk = _chunk(b"IDAT", self._data(lines, canvas.first + first, canvas.second + second))
        return Picture(b"".join((self._beginning, *chunk, *_IEND)), self._width, self._height)

    def _lay(self, lines: bytearray, tiles: EncodedTiles, at: int) -> tuple[int, int]:
        """Write whole rows of tiles, the first of them `at`; return how much they add to the sums."""
        shown = tiles.lines.reshape(-1, self._across, self._rows)
        place = np.ndarray(shown.shape, self._tile_lines, lines, self._offset + at * self._strides[0], self._strides)
        place[...] = shown
        sums, begin = tiles.sums.ravel(), 2 * at * self._across
        first, second = (sums @ self._weights[begin : begin + len(sums)]).tolist()
        return first, second

    def _data(self, lines: bytearray, first: int, second: int) -> list[bytes | bytearray]:
        """The zlib stream, in parts; `lines` are the bytes from the beginning to the last line, with their sums."""
        raise NotImplementedError


class _Stored(Layout):
    """Pictures in stored blocks; before each row is the number of the filter that is not used."""

    def __init__(self, down: int, across: int, rows: int, columns: int, scale: int) -> None:
        super().__init__(down, across, rows * scale, columns * scale, 1)
        self._enlarged = scale
        self._lay_out(b"\0", b"\0", 3 * columns * scale, down, rows * scale)

    def encoded(self, tiles: NDArray[np.uint8]) -> EncodedTiles:
        pixels = tiles.transpose(0, 2, 3, 1).repeat(self._enlarged, 1).repeat(self._enlarged, 2)
        lines = np.frombuffer(pixels.tobytes(), self._tile_lines).reshape(pixels.shape[:2])
        return EncodedTiles(lines, np.zeros((len(tiles), 2), np.int64))

    def _data(self, lines: bytearray, first: int, second: int) -> list[bytes | bytearray]:
        stream: list[bytes | bytearray] = [_ZLIB_HEADER]
        for at in range(0, len(lines), _STORED):
            block = lines[at : at + _STORED]
            stream += [struct.pack("<BHH", at + _STORED >= len(lines), len(block), len(block) ^ 0xFFFF), block]
        return [*stream, struct.pack(">I", zlib.adler32(lines))]


class _Compressed(Layout):
    """Pictures whose pixels are words of 32 bits.

    Adler-32's second sum counts each byte as often as there are bytes from it to the end: as often as the same byte of
    the tile at the top left, less the bytes between the two. All are remainders of whole numbers, and the sums over a
    tile are far below 2**53, so floats hold them exactly, in any order.
    """

    def __init__(self, down: int, across: int, rows: int, columns: int, scale: int) -> None:
        super().__init__(down, across, rows, columns, scale)
        code = _code(across * columns, scale)
        before, joint = _pack([*code.header, code.literals[0]]), _pack([*code.repeat_row, code.literals[0]])
        self._lay_out(_ZLIB_HEADER + before, joint, 4 * columns, down, rows)
        self._after = _pack([*code.repeat_row, code.end])
        repeat, used = _joined(code.repeat_pixel)
        assert used + 3 * _LITERAL == 32
        values = np.array([value for value, _ in code.literals], np.uint32)
        self._words = values, values << _LITERAL, values << 2 * _LITERAL | repeat << 3 * _LITERAL
        down_from_top = np.arange(rows * scale)[:, None, None] * (1 + 3 * self._width)
        before_it = 1 + down_from_top + np.arange(3 * columns * scale).reshape(1, -1, 3)
        second = (self._length - before_it).reshape(rows, scale, columns, scale, 3).sum((1, 3))
        second = second.transpose(2, 0, 1).ravel()
        self._sums = np.stack([np.full_like(second, scale * scale), second % _ADLER], axis=1).astype(np.float64)

    def encoded(self, tiles: NDArray[np.uint8]) -> EncodedTiles:
        red, green, blue = self._words
        words = red.take(tiles[:, 0])
        words |= green.take(tiles[:, 1])
        words |= blue.take(tiles[:, 2])
        lines = words.astype("<u4", copy=False).view(self._tile_lines)[..., 0]
        return EncodedTiles(lines, (tiles.reshape(len(tiles), -1).astype(np.float64) @ self._sums).astype(np.int64))

    def _data(self, lines: bytearray, first: int, second: int) -> list[bytes | bytearray]:
        adler = (self._length + second) % _ADLER << 16 | (1 + first) % _ADLER
        return [lines, self._after, struct.pack(">I", adler)]


@functools.lru_cache(16)
def layout_of(down: int, across: int, rows: int, columns: int, scale: int) -> Layout:
    """Return the layout of pictures of `down` x `across` tiles, each of rows x columns, enlarged `scale` times."""
    if not 1 <= scale <= LARGEST_SCALE:
        raise InvalidArgumentError(f"A picture is enlarged 1 to {LARGEST_SCALE} times, not {scale}.")
    is_stored = scale == 1 or 1 + 3 * across * columns * scale > _WINDOW
    return (_Stored if is_stored else _Compressed)(down, across, rows, columns, scale)


def _beginning(width: int, height: int) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"".join((_SIGNATURE, *_chunk(b"IHDR", [header])))


def _chunk(kind: bytes, parts: Sequence[bytes | bytearray]) -> list[bytes | bytearray]:
    """The parts of a chunk whose data is in parts: they are joined once, with the rest of the file."""
    checksum = zlib.crc32(kind)
    for part in parts:
        checksum = zlib.crc32(part, checksum)
    return [struct.pack(">I", sum(map(len, parts))), kind, *parts, struct.pack(">I", checksum)]


_IEND = _chunk(b"IEND", [])


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
    after = _LONGEST_MATCH if table is _LENGTHS else _WINDOW
    most = table[number + 1] if number + 1 < len(table) else after + 1
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
