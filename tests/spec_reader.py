#!/usr/bin/env python3
"""A second reader of the Relevo container, written from format-spec.md alone.

It reads every byte of a file, checks what the text says a file is, and prints one line per tile in
storage order:

    level/x/y children flags sha256(heights) sha256(validity) sha256(errors)

and then, if the file has imagery, a line for the layer and one for each of its tiles (JPEG and WebP are decoded if
Pillow is there):

    imagery level/x/y children sha256(colour) sha256(alpha)

With --json the same is one JSON object: header, metadata, statistics, and for each tile its row of the index, the three
sums, and its first two rows (of a root of up to 33 x 33: all of them).

heights:  i32 codes row by row, then (float64) u32 lows; void samples as 0
validity: one byte per sample, 0 void, 1 valid
errors:   one byte per patch (drawable), then u16 vertical, then u16 horizontal codes, [step][patch]
(all little-endian)

It favours being easy to follow over being fast. It does not draw, convert or repair.
Numbers after a '#' are sections of format-spec.md.
"""
import argparse
import hashlib
import json
import math
import os
import struct
import sys
import zlib
from array import array

import zstandard


class Violation(Exception):
    """The file is not what the specification says."""


def need(condition, message):
    if not condition:
        raise Violation(message)


# ---- 1. Conventions ---------------------------------------------------------------------------

def frame(data, limit, place):
    """Decode one zstd frame that states its size (at most `limit`) and is all there is in `data`."""
    try:
        need(data[:4] == b"\x28\xb5\x2f\xfd", f"{place}: not a zstd frame")
        head = zstandard.get_frame_parameters(data)
        need(head.content_size != zstandard.CONTENTSIZE_UNKNOWN, f"{place}: frame without its size")
        need(head.content_size <= limit, f"{place}: frame of {head.content_size} bytes, at most {limit}")
        need(head.dict_id == 0, f"{place}: frame with a dictionary")
        return zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)
    except zstandard.ZstdError as e:
        raise Violation(f"{place}: {e}") from None


def check_crc(data, crc, place):
    need(zlib.crc32(data) == crc, f"{place}: CRC {zlib.crc32(data):08x}, expected {crc:08x}")


def little(numbers):
    """The bytes of an array.array, little-endian."""
    if sys.byteorder == "big":
        numbers = numbers[:]
        numbers.byteswap()
    return numbers.tobytes()


def wrap(x):
    """x modulo 2^32, as an i32."""
    return ((x + 0x80000000) & 0xFFFFFFFF) - 0x80000000


def take_bits(data, count, place):
    """`count` bits from the least significant on, one a byte; the rest of the last byte is 0."""
    bits = bytearray()
    for byte in data:
        bits += BITS_OF[byte]
    need(not any(bits[count:]), f"{place}: unused bits are not 0")
    return bits[:count]


BITS_OF = [bytes(byte >> i & 1 for i in range(8)) for byte in range(256)]


# ---- 3, 4. Header and section table -----------------------------------------------------------

HEADER = struct.Struct("<8sHHIIIQIIBBBBBBHdddddd d6dQ92sI")
VERSIONS = (1, 2)
TYPE_NAMES = {1: "int8", 2: "uint8", 3: "int16", 4: "uint16", 5: "int32", 6: "uint32", 7: "float32", 8: "float64"}
SOURCE_TYPES = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}
KNOWN = {1: ("metadata", 2), 2: ("root page", 3), 3: ("statistics", 2), 4: ("pages", 1), 5: ("tiles", 1),
         16: ("imagery", 2), 17: ("imagery pages", 0), 18: ("imagery tiles", 0)}


class Header:
    def __init__(self, data):
        need(len(data) >= 256, "header: the file is shorter than 256 bytes")
        (magic, self.version, length, required, _optional, self.sections, file_length, self.w, self.h,
         log_t, log_p, self.depth, self.metric, self.kind, self.source, flags, self.scale, self.offset,
         self.band_scale, self.band_offset, self.unit, self.quant, self.nodata, *geo, self.tiles,
         reserved, crc) = HEADER.unpack_from(data)
        need(magic == b"\x89RLV\r\n\x1a\n", "header: not a Relevo file")
        need(self.version in VERSIONS, f"header: version {self.version} is not known")
        need(length == 256, f"header: length {length}")
        need(1 <= self.sections <= 64, f"header: {self.sections} sections")
        end = 256 + 32 * self.sections
        need(len(data) >= end, "header: the section table is cut off")
        check_crc(data[:252] + data[256:end], crc, "header and section table")
        need(required == 0, f"header: required feature bit {(required & -required).bit_length() - 1} is not known")
        need(file_length == len(data), f"header: {file_length} bytes expected, the file has {len(data)}")
        need(1 <= self.w <= 1 << 30 and 1 <= self.h <= 1 << 30, f"header: {self.w} x {self.h} samples")
        need(4 <= log_t <= 10, f"header: log2 T = {log_t}")
        need(2 <= log_p <= min(6, log_t), f"header: log2 P = {log_p}")
        self.has_nodata = bool(flags & 2)
        self.t, self.p, self.steps = 1 << log_t, 1 << log_p, log_p + 1
        intervals, least = max(self.w, self.h) - 1, 0
        while self.t << least < intervals:  # 2: L is the least that fits
            least += 1
        need(self.depth == least, f"header: L = {self.depth}, expected {least}")
        need(self.metric in (1, 2), f"header: metric {self.metric} is not known")
        need(self.kind in (1, 2, 3), f"header: sample kind {self.kind} is not known")
        need(self.source in SOURCE_TYPES, f"header: source type {self.source} is not known")
        need(self.kind == 1 or self.source == {2: 7, 3: 8}[self.kind], f"header: floats of source type {self.source}")
        need(not flags & 4 or self.kind == 1, "header: floats that are quantised")
        need(flags < 8, f"header: reserved flags {flags:#x}")
        need(not any(reserved), "header: reserved bytes are not 0")
        doubles = (self.scale, self.offset, self.band_scale, self.band_offset, self.unit, self.quant, *geo)
        need(all(map(math.isfinite, doubles)), "header: scale, offset or unit is not finite")
        need(self.scale != 0 and self.band_scale != 0 and self.unit > 0, "header: scale or unit is 0")
        need(self.kind == 1 or (self.scale, self.offset) == (1, 0), "header: floats have scale 1, offset 0")
        need(self.quant > 0 if flags & 4 else self.quant == 0, f"header: quantisation error {self.quant}")
        need(flags & 2 or self.nodata == 0, "header: a nodata value without its flag")
        need(flags & 1 or not any(geo), "header: a geotransform without its flag")
        need(self.tiles >= 1, "header: no tiles")
        self.geo = geo if flags & 1 else None

    def json(self):
        return {"version": self.version, "width": self.w, "height": self.h, "tile": self.t, "patch": self.p,
                "leaf_level": self.depth, "metric": {1: "paper", 2: "bound"}[self.metric], "sample_kind": self.kind,
                "source_type": TYPE_NAMES[self.source], "scale": self.scale, "offset": self.offset,
                "band_scale": self.band_scale, "band_offset": self.band_offset, "unit_metres": self.unit,
                "quantisation_error": self.quant, "nodata": float_json(self.nodata) if self.has_nodata else None,
                "geotransform": self.geo, "tile_count": self.tiles}

    def value(self, code, low=0):
        """2: the value of a code in the source's own numbers."""
        if self.kind == 1:
            return self.offset + self.scale * code
        if self.kind == 2:
            return struct.unpack("<f", struct.pack("<i", code if code >= 0 else code ^ 0x7FFFFFFF))[0]
        bits = (code << 32) + low
        return struct.unpack("<d", struct.pack("<q", bits if bits >= 0 else bits ^ 0x7FFFFFFFFFFFFFFF))[0]

    def metres(self, code, low=0):
        return (self.band_offset + self.band_scale * self.value(code, low)) * self.unit


def float_json(value):
    """A number, or its name: JSON has no NaN and no infinity."""
    return value if math.isfinite(value) else str(value)


def read_sections(data, header):
    """{kind: (offset, bytes)} of the known sections."""
    sections, extents = {}, []
    view = memoryview(data)
    for at in range(256, 256 + 32 * header.sections, 32):
        kind, flags, offset, length, crc, reserved = struct.unpack_from("<IIQQII", data, at)
        place = f"section of kind {kind}"
        need(flags < 4 and reserved == 0, f"{place}: reserved bits are not 0")
        need(offset + length <= len(data), f"{place}: lies outside the file")
        need(flags & 2 or crc == 0, f"{place}: a CRC without its flag")
        extents.append((offset, offset + length))
        if kind not in KNOWN:
            need(not flags & 1, f"{place}: required, and not known")
            continue
        need(kind not in sections, f"{place}: twice")
        need(flags == KNOWN[kind][1], f"{place}: flags {flags}, expected {KNOWN[kind][1]}")
        part = view[offset:offset + length]
        if flags & 2:
            check_crc(part, crc, KNOWN[kind][0])
        if kind <= 2:
            need(offset + length <= 65536, f"{place}: does not lie within the first 65536 bytes")
        sections[kind] = (offset, part)
    need(all(kind in sections for kind in (1, 2, 4, 5)), "section table: kinds 1, 2, 4 and 5 have to be there")
    need(sum(kind in sections for kind in (16, 17, 18)) in (0, 3), "section table: a part of the imagery is missing")
    check_tiling(extents, 256 + 32 * header.sections, len(data), "sections")
    return sections


def check_tiling(extents, start, end, place):
    """The extents cover start..end without gap or overlap."""
    for first, last in sorted(extents):
        need(first == start, f"{place}: a gap or an overlap at {min(first, start)}")
        start = last
    need(start == end, f"{place}: end at {start}, expected {end}")


def read_json(data, place):
    try:
        value = json.loads(bytes(data).decode("utf-8"))
    except (ValueError, RecursionError) as e:
        raise Violation(f"{place}: {e}") from None
    need(isinstance(value, dict), f"{place}: not a JSON object")
    return value


# ---- 6. Index ---------------------------------------------------------------------------------

class Tile:
    __slots__ = ("level", "x", "y", "children", "flags", "vertical", "horizontal", "low", "high", "offset",
                 "lengths", "crcs", "codes", "lows", "valid", "drawable", "v", "h", "below")

    def name(self):
        return f"{self.level}/{self.x}/{self.y}"


def page_depth(level, deepest):
    """Levels of the page whose root tile stands at `level`: up to the next page roots, or to L."""
    for l in range(level + 1, deepest + 1):
        if (deepest + 1 - l) % 5 == 0:
            return l - level
    return deepest + 1 - level


def read_page(stored, header, place, level, x, y):
    """The tiles of a page, and (place, offset, length, crc) of the pages it refers to."""
    data = frame(stored, 1 << 20, place)
    need(len(data) >= 16, f"{place}: too short")
    got_level, depth, reserved, got_x, got_y, n = struct.unpack_from("<BBHIII", data)
    need(reserved == 0, f"{place}: reserved bits are not 0")
    need((got_level, got_x, got_y) == (level, x, y), f"{place}: holds {got_level}/{got_x}/{got_y}")
    need(depth == page_depth(level, header.depth), f"{place}: {depth} levels")
    need(1 <= n <= 341, f"{place}: {n} tiles")
    at = 16

    def column(letter, count):
        nonlocal at
        need(at + struct.calcsize(f"<{count}{letter}") <= len(data), f"{place}: cut off")
        values = struct.unpack_from(f"<{count}{letter}", data, at)
        at += struct.calcsize(f"<{count}{letter}")
        return values

    columns = [column(letter, n) for letter in "BBHHffQIIIIII"]
    tiles, here = [], [(level, x, y)]
    for l in range(level, level + depth):
        need(len(tiles) + len(here) <= n, f"{place}: more tiles than {n}")
        below = []
        for position in here:
            tile = Tile()
            i = len(tiles)
            (tile.children, tile.flags, tile.vertical, tile.horizontal, tile.low, tile.high, tile.offset,
             *chunks) = (c[i] for c in columns)
            tile.level, tile.x, tile.y = position
            tile.lengths, tile.crcs = chunks[:3], chunks[3:]
            check_entry(tile, header)
            for q in range(4):
                if tile.children >> q & 1:
                    below.append((l + 1, 2 * tile.x + (q & 1), 2 * tile.y + (q >> 1)))
            tiles.append(tile)
        here = below
    need(len(tiles) == n, f"{place}: {n} tiles, its children bits say {len(tiles)}")
    refers = list(zip(here, *(column(letter, len(here)) for letter in "QII")))
    need(at == len(data), f"{place}: {len(data) - at} bytes too many")
    return tiles, refers


def check_entry(tile, header):
    place = f"tile {tile.name()}"
    need(tile.children < 16 and tile.flags < 4, f"{place}: reserved bits are not 0")
    need(tile.flags, f"{place}: neither valid nor void")
    need(tile.level < header.depth or not tile.children, f"{place}: children below level L")
    reach = header.t << (header.depth - tile.level)
    need(tile.x * reach < header.w and tile.y * reach < header.h, f"{place}: outside the raster")
    need(tile.vertical <= 0xFF00 and tile.horizontal <= 0xFF00, f"{place}: error code above 0xFF00")
    need(tile.low <= tile.high, f"{place}: height range {tile.low}..{tile.high}")  # also false for NaN
    need(tile.lengths[2], f"{place}: no errors")
    need(tile.flags == 3 or not tile.lengths[1], f"{place}: a mask, though all samples are alike")
    need(tile.flags != 3 or tile.lengths[1], f"{place}: no mask, though valid and void samples")
    need(max(tile.lengths) <= 16 * (header.t + 1) ** 2 + 65536, f"{place}: chunk above the limit")
    # 2: a tile exists if there is a valid sample; at level L there are no others than its own.
    need(tile.level < header.depth or tile.flags & 1, f"{place}: exists without a valid sample")


def hilbert(tile):
    """7: position of a tile within its level."""
    x, y, d = tile.x, tile.y, 0
    for bit in range(tile.level - 1, -1, -1):
        side = 1 << bit
        rx, ry = x >> bit & 1, y >> bit & 1
        d += side * side * ((3 * rx) ^ ry)
        x, y = x % side, y % side
        if ry == 0:
            if rx == 1:
                x, y = side - 1 - x, side - 1 - y
            x, y = y, x
    return d


def read_index(sections, header):
    """All tiles in storage order."""
    pages = sections[4][1]
    tiles, refers = read_page(sections[2][1], header, "root page", 0, 0, 0)
    waiting = [(r, len(pages)) for r in refers]  # the root page may refer to any
    extents = []
    while waiting:
        ((level, x, y), offset, length, crc), limit = waiting.pop()
        place = f"page {level}/{x}/{y}"
        need(offset + length <= limit, f"{place}: does not end before the page that refers to it")
        extents.append((offset, offset + length))
        stored = pages[offset:offset + length]
        check_crc(stored, crc, place)
        more, refers = read_page(stored, header, place, level, x, y)
        tiles += more
        need(len(tiles) <= header.tiles, f"index: more than {header.tiles} tiles")
        waiting += [(r, offset) for r in refers]
    need(len(tiles) == header.tiles, f"index: {len(tiles)} tiles, the header says {header.tiles}")
    check_tiling(extents, 0, len(pages), "pages")
    tiles.sort(key=lambda tile: (tile.level, hilbert(tile)))
    at = 0
    for tile in tiles:  # 7: stored in this order, 3: without gaps
        need(tile.offset == at, f"tile {tile.name()}: chunks at {tile.offset}, expected at {at}")
        at += sum(tile.lengths)
    need(at == len(sections[5][1]), f"tiles section: {len(sections[5][1])} bytes, its chunks have {at}")
    return tiles


# ---- 7. The lattice of a tile -----------------------------------------------------------------

def newborn_of_stage(m):
    """Places of C, H and V, in this order, in the lattice of (2m + 1)^2 that a stage makes."""
    side = 2 * m + 1
    return ([(2 * b + 1) * side + 2 * a + 1 for b in range(m) for a in range(m)]
            + [2 * b * side + 2 * a + 1 for b in range(m + 1) for a in range(m)]
            + [(2 * b + 1) * side + 2 * a for b in range(m) for a in range(m + 1)])


def stages(t, root):
    """Half-sizes m of the refinements of a tile: a chain in the root, one in others."""
    return [1 << s for s in range(t.bit_length() - 1)] if root else [t // 2]


def newborn_count(t, root):
    return (t + 1) ** 2 - (0 if root else (t // 2 + 1) ** 2)


def quarter(numbers, t, x, y):
    """The samples of a parent at the even samples of child (x mod 2, y mod 2): the P."""
    m, side = t // 2, t + 1
    start = (y % 2) * m * side + (x % 2) * m
    out = numbers[0:0]
    for b in range(m + 1):
        out += numbers[start + b * side:start + b * side + m + 1]
    return out


def spread(even, m, empty):
    """A lattice of (2m + 1)^2 with `even` at its even samples."""
    side = 2 * m + 1
    out = empty * (side * side)
    for b in range(m + 1):
        out[2 * b * side:(2 * b + 1) * side:2] = even[b * (m + 1):(b + 1) * (m + 1)]
    return out


# ---- 8. Void mask -----------------------------------------------------------------------------

def refine_validity(m, even, wrong, at):
    """One stage: validity of the lattice of (2m + 1)^2. `wrong[at:]`: whose prediction is wrong."""
    side = 2 * m + 1
    out = spread(even, m, bytearray(1))
    for o in newborn_of_stage(m):
        row, column = divmod(o, side)
        if row & column & 1:  # C: its four P
            voters = [o - side - 1, o - side + 1, o + side - 1, o + side + 1]
        else:  # H and V: two P and one or two C
            voters = [o - side] * (row > 0) + [o + side] * (row < side - 1)
            voters += [o - 1] * (column > 0) + [o + 1] * (column < side - 1)
        votes = sum([out[voter] for voter in voters])
        out[o] = wrong[at] ^ (2 * votes >= len(voters))
        at += 1
    return out


def decode_validity(tile, chunk, t, parent):
    """Validity after every stage (the last: of the whole tile)."""
    place, n = f"tile {tile.name()} mask", newborn_count(t, parent is None)
    even = None if parent is None else quarter(parent.valid, t, tile.x, tile.y)
    if tile.flags != 3:
        alike = tile.flags & 1
        need(even is None or set(even) == {alike}, f"{place}: differs from the parent")
        corners, wrong = bytearray([alike] * 4), None
    else:
        packed = frame(chunk, (n + 7) // 8, place)
        need(len(packed) == (n + 7) // 8, f"{place}: {len(packed)} bytes for {n} samples")
        wrong = take_bits(packed, n, place)
        corners = bytearray(1 ^ bit for bit in wrong[:4])  # predicted valid
    lattices, at = [corners if even is None else even], 4 if even is None else 0
    for m in stages(t, parent is None):
        if wrong is None:
            lattices.append(bytearray([alike]) * (2 * m + 1) ** 2)
        else:
            lattices.append(refine_validity(m, lattices[-1], wrong, at))
            at += 3 * m * m + 2 * m
    need(wrong is None or set(lattices[-1]) == {0, 1}, f"{place}: its samples are alike, the flags deny it")
    return lattices


# ---- 9. Heights -------------------------------------------------------------------------------

DIVISORS = [0, 1, 2, 4, 8, 16, 32, 64, 128, 256, 10, 100, 1000]  # 9.3


def read_heights(chunk, n, kind, place):
    """(residuals, transform, sharpness, skew, lows, narrow)"""
    if not len(chunk):
        return [0] * n, 0, 5, 0, array("I", bytes(4 * n)), False
    need(len(chunk) >= 12, f"{place}: too short")
    flags, k, transform, weights, a, b = struct.unpack_from("<BBBBII", chunk)
    need(flags < 2, f"{place}: reserved flags")
    need(k <= 24, f"{place}: {k} raw bits")
    need(transform == 0 or (kind == 2 and transform <= 12), f"{place}: transform {transform} is not known")
    sharpness, skew = weights & 15, (weights >> 4) - 8
    need(sharpness <= 7 and skew >= -7, f"{place}: weights {weights:#x}")
    need((b > 0) == (kind == 3), f"{place}: lows of {b} bytes")
    raw_bytes = (n * k + 7) // 8
    need(12 + a + raw_bytes + b == len(chunk), f"{place}: its parts do not fill it")
    plane = frame(chunk[12:12 + a], 6 * n, f"{place}, byte plane")
    raw = chunk[12 + a:12 + a + raw_bytes]
    residuals = join_residuals(plane, bytes(raw), n, k, place)
    lows = array("I", bytes(4 * n))
    if kind == 3:  # 9.4
        planes = frame(chunk[12 + a + raw_bytes:], 4 * n, f"{place}, lows")
        need(len(planes) == 4 * n, f"{place}: {len(planes)} bytes of lows")
        p0, p1, p2, p3 = (planes[i * n:(i + 1) * n] for i in range(4))
        lows = array("I", [q | r << 8 | s << 16 | u << 24 for q, r, s, u in zip(p0, p1, p2, p3)])
    return residuals, transform, sharpness, skew, lows, bool(flags & 1)


def join_residuals(plane, raw, n, k, place):
    """9.1: bytes, escapes and raw bits to residuals."""
    need(len(plane) >= n, f"{place}: {len(plane)} bytes for {n} samples")
    high, at = list(plane[:n]), n
    i = plane.find(255, 0, n)
    while i >= 0:
        number = shift = 0
        while True:
            need(at < len(plane) and shift < 35, f"{place}: bad escape")
            number |= (plane[at] & 127) << shift
            shift += 7
            at += 1
            if plane[at - 1] < 128:
                break
        need(number < 1 << 32, f"{place}: escape above 32 bits")
        high[i] += number
        need(high[i] << k < 1 << 32, f"{place}: residual above 32 bits")
        i = plane.find(255, i + 1, n)
    need(at == len(plane), f"{place}: escapes are left over")
    if k:
        mask = (1 << k) - 1
        for group in range(0, n, 8):  # eight samples have k bytes
            word = int.from_bytes(raw[group // 8 * k:(group // 8 + 1) * k], "little")
            for i in range(group, min(group + 8, n)):
                high[i] = high[i] << k | word & mask
                word >>= k
        need(word == 0 or n % 8 == 0, f"{place}: unused bits are not 0")
    return [(g >> 1) ^ -(g & 1) for g in high]


def replace_voids(even, valid, m):
    """9.2 Parents: the P as rows, void samples replaced."""
    side = m + 1
    rows = []
    for b in range(side):
        row, seen = even[b * side:(b + 1) * side], valid[b * side:(b + 1) * side]
        known = [a for a in range(side) if seen[a]]
        if not known:
            rows.append(None)
            continue
        for a in range(known[0]):
            row[a] = row[known[0]]
        for a0, a1 in zip(known, known[1:]):
            for a in range(a0 + 1, a1):
                row[a] = row[a0] + (row[a1] - row[a0]) * (a - a0) // (a1 - a0)
        for a in range(known[-1] + 1, side):
            row[a] = row[known[-1]]
        rows.append(row)
    first = next((row for row in rows if row is not None), [0] * side)
    for b in range(side):
        if rows[b] is None:
            rows[b] = (rows[b - 1] if b else first)[:]
    return rows


def pad(rows):
    """9.2 Padding: one sample more on each side, so that X(a, b) is at [b + 1][a + 1]."""
    def before(x, y):
        return 2 * x - y
    if len(rows) == 1:
        x = rows[0][0]
        return [[x] * 3 for _ in range(3)]
    wide = [[before(r[0], r[1]), *r, before(r[-1], r[-2])] for r in rows]
    top = [before(x, y) for x, y in zip(rows[0], rows[1])]
    bottom = [before(x, y) for x, y in zip(rows[-1], rows[-2])]
    return [[0, *top, 0], *wide, [0, *bottom, 0]]  # corners are never used


def refine_heights(m, even, even_valid, valid, residuals, i, j, beyond):
    """9.2, one stage: codes of the lattice of (2m + 1)^2. `beyond`: void C may leave the range of an i32 (17, version 1)."""
    side = 2 * m + 1
    P = pad(replace_voids(even, even_valid, m))
    out = spread(even, m, [0])
    stream = zip(newborn_of_stage(m), residuals)
    voids = []  # (place, prediction, residual), finished at the end

    def newborn(prediction):
        """The next sample of the streams. Returns what stands for it in later predictions."""
        o, residual = next(stream)
        if valid[o] or not beyond:
            prediction = wrap(prediction)
        if valid[o]:
            out[o] = prediction = wrap(prediction + residual)
        else:
            voids.append((o, prediction, residual))
        return prediction

    C = []
    near = 32 + 2 * i
    for b in range(m):
        p, q, r, s = P[b:b + 4]  # rows b - 1, b, b + 1, b + 2
        row = []
        for a in range(m):
            s4 = q[a + 1] + q[a + 2] + r[a + 1] + r[a + 2]
            s8 = q[a] + r[a] + q[a + 3] + r[a + 3] + p[a + 1] + p[a + 2] + s[a + 1] + s[a + 2]
            row.append(newborn((near * s4 - i * s8 + 64) >> 7))
        C.append(row)
    C = pad(C)

    we, wn, fe, fn = near + 4 * j, near - 4 * j, i + j, i - j
    for b in range(m + 1):  # H
        p, q, r = P[b:b + 3]  # rows b - 1, b, b + 1 of P
        c, d = C[b], C[b + 1]  # rows b - 1, b of C
        inner = 0 < b < m
        for a in range(m):
            if inner:
                e4 = c[a] + d[a] + c[a + 2] + d[a + 2]
                n4 = p[a + 1] + p[a + 2] + r[a + 1] + r[a + 2]
                prediction = (we * (q[a + 1] + q[a + 2]) + wn * (c[a + 1] + d[a + 1]) - fe * e4 - fn * n4 + 64) >> 7
            else:
                prediction = (9 * (q[a + 1] + q[a + 2]) - q[a] - q[a + 3] + 8) >> 4
            newborn(prediction)
    for b in range(m):  # V
        p, q, r, s = P[b:b + 4]  # rows b - 1, b, b + 1, b + 2 of P
        c, d, e = C[b:b + 3]  # rows b - 1, b, b + 1 of C
        for a in range(m + 1):
            if 0 < a < m:
                e4 = q[a] + r[a] + q[a + 2] + r[a + 2]
                n4 = c[a] + c[a + 1] + e[a] + e[a + 1]
                prediction = (we * (d[a] + d[a + 1]) + wn * (q[a + 1] + r[a + 1]) - fe * e4 - fn * n4 + 64) >> 7
            else:
                prediction = (9 * (q[a + 1] + r[a + 1]) - p[a + 1] - s[a + 1] + 8) >> 4
            newborn(prediction)

    for o, prediction, residual in voids:  # all valid samples are known now; void ones are not looked at
        row, column = divmod(o, side)
        around = sorted(out[y * side + x]
                        for y in range(max(row - 1, 0), min(row + 2, side))
                        for x in range(max(column - 1, 0), min(column + 2, side)) if valid[y * side + x])
        if around:
            prediction = around[(len(around) - 1) // 2]
        out[o] = wrap(prediction + residual)
    return out


def to_q(code, s, header):
    """9.3: a code as it enters the predictions."""
    x = header.value(code) * s
    if math.isnan(x):
        return 0
    return math.floor(min(max(x + 0.5, -2147483648.0), 2147483647.0))


def from_q(numbers, s):
    """9.3: ordered bits of f32(q / s)."""
    bits = array("i", array("f", [q / s for q in numbers]).tobytes())
    return [b if b >= 0 else b ^ 0x7FFFFFFF for b in bits]


def decode_heights(tile, chunk, header, parent, lattices):
    """Fills codes and lows of a tile."""
    t, root, place = header.t, parent is None, f"tile {tile.name()} heights"
    n = newborn_count(t, root)
    residuals, d, sharpness, skew, new_lows, narrow = read_heights(chunk, n, header.kind, place)
    beyond = narrow and header.version == 1
    s = DIVISORS[d]
    if root:
        now, at = [], 4
        for e in residuals[:4]:
            now.append(wrap(e + (now[-1] if now else 0)))
    else:
        codes = quarter(parent.codes, t, tile.x, tile.y)
        now, at = [to_q(c, s, header) for c in codes] if d else list(codes), 0
    chain = stages(t, root)
    for stage, m in enumerate(chain):
        count = 3 * m * m + 2 * m
        now = refine_heights(m, now, lattices[stage], lattices[stage + 1], residuals[at:at + count], sharpness, skew,
                             beyond)
        at += count
    if d:
        now = from_q(now, s)
        if not root:  # even samples keep their code
            half = t // 2 + 1
            for b in range(half):
                now[2 * b * (t + 1):(2 * b + 1) * (t + 1):2] = codes[b * half:(b + 1) * half]
    tile.codes, tile.lows = array("i", now), None
    if header.kind == 3:
        lows, at = (new_lows[:4], 4) if root else (quarter(parent.lows, t, tile.x, tile.y), 0)
        for m in chain:
            lows = spread(lows, m, array("I", [0]))
            for o in newborn_of_stage(m):
                lows[o] = new_lows[at]
                at += 1
        tile.lows = lows


# ---- 10. Error table --------------------------------------------------------------------------

def decode_errors(tile, chunk, header):
    """Fills drawable (a byte a patch), v and h: codes, [step][patch]."""
    place, steps = f"tile {tile.name()} errors", header.steps
    side = header.t // header.p
    n = side * side
    head, plane = (n + 7) // 8, n * steps
    data = frame(chunk, head + 4 * plane, place)
    need(len(data) == head + 4 * plane, f"{place}: {len(data)} bytes for {n} patches")
    tile.drawable = bytes(take_bits(data[:head], n, place))
    tables = []
    for start in (head, head + 2 * plane):
        codes = array("H", [lo | hi << 8 for lo, hi in zip(data[start:start + plane], data[start + plane:])])
        for i in range(plane):
            sum_ = codes[i] + (codes[i - n] if i >= n else 0)
            need(sum_ <= 0xFF00, f"{place}: error code above 0xFF00")
            codes[i] = sum_
        tables.append(codes)
    tile.v, tile.h = tables
    need(tile.vertical == max(tile.v[:n]), f"{place}: index says {tile.vertical}, largest is {max(tile.v[:n])}")
    need(tile.horizontal == max(tile.h[:n]), f"{place}: index says {tile.horizontal}, largest is {max(tile.h[:n])}")
    for patch in range(n):
        x0, y0 = patch % side * header.p, patch // side * header.p
        rows = range(y0 * (header.t + 1) + x0, (y0 + header.p + 1) * (header.t + 1), header.t + 1)
        drawable = any(any(tile.valid[o:o + header.p + 1]) for o in rows)
        need(drawable == tile.drawable[patch], f"{place}: patch {patch} drawable, or not, against its samples")


def check_against_parent(tile, parent, header):
    """2: errors at step k are not below those of the child patches at step k + 1. 6: the range neither."""
    side = header.t // header.p
    n = side * side
    for patch in range(n):
        x, y = tile.x % 2 * side + patch % side, tile.y % 2 * side + patch // side
        up = y // 2 * side + x // 2
        for mine, theirs in ((tile.v, parent.v), (tile.h, parent.h)):
            need(all(theirs[k * n + up] >= mine[(k + 1) * n + patch] for k in range(header.steps - 1)),
                 f"tile {tile.name()} errors: patch {patch} above its parent's")
    need(parent.low <= tile.low and tile.high <= parent.high, f"tile {tile.name()}: height range beyond its parent's")


# ---- 11. Statistics ---------------------------------------------------------------------------

def check_statistics(statistics, tiles, header):
    """The members that say something about the tiles, against the tiles."""
    levels = statistics.get("levels")
    need(isinstance(levels, list) and len(levels) == header.depth + 1, "statistics: not one object a level")
    for tile in reversed(tiles):  # patches below which there is a valid sample, from the leaves up
        side = header.t // header.p
        tile.below = bytearray(tile.drawable)
        for q in range(4):
            child = tiles_at.get((tile.level + 1, 2 * tile.x + q % 2, 2 * tile.y + q // 2))
            for patch in range(side * side) if child else ():
                up = (q // 2 * side + patch // side) // 2 * side + (q % 2 * side + patch % side) // 2
                tile.below[up] |= child.below[patch]
    for number, level in enumerate(levels):
        here = [tile for tile in tiles if tile.level == number]
        apart = header.depth - number
        expected = {
            "level": number, "tiles": len(here), "patches": sum(sum(tile.drawable) for tile in here),
            "columns": ((header.w - 1) >> apart) + 1, "rows": ((header.h - 1) >> apart) + 1,
            "valid": sum(own_valid(tile, header) for tile in here),
            "heights_bytes": sum(tile.lengths[0] for tile in here),
            "masks_bytes": sum(tile.lengths[1] for tile in here),
            "errors_bytes": sum(tile.lengths[2] for tile in here)}
        for member, want in expected.items():
            got = level.get(member)
            need(got == want, f"statistics: level {number}: {member} {got}, expected {want}")
        need(len(level["steps"]) == header.steps, f"statistics: level {number}: not one object a step")
        for k, step in enumerate(level["steps"]):
            for table in ("vertical", "horizontal"):
                n = len(here[0].drawable)
                codes = sorted((t.v if table == "vertical" else t.h)[k * n + patch]
                               for t in here for patch in range(n) if t.below[patch])
                check_summary(step[table], codes, f"statistics: level {number}, step {k}, {table}")


def own_valid(tile, header):
    """Valid samples of a tile that are not those of its neighbour to the east or south."""
    side = header.t + 1
    columns = header.t if (tile.level, tile.x + 1, tile.y) in tiles_at else side
    rows = header.t if (tile.level, tile.x, tile.y + 1) in tiles_at else side
    return sum(sum(tile.valid[b * side:b * side + columns]) for b in range(rows))


def check_summary(summary, codes, place):
    def metres(code):  # 10: the f32 with bits c << 15; null if infinite
        return None if code == 0xFF00 else struct.unpack("<f", struct.pack("<I", code << 15))[0]

    def rank(percent):
        return codes[max(-(-percent * len(codes) // 100) - 1, 0)]
    expected = {"min": codes[0], "max": codes[-1], "p50": rank(50), "p90": rank(90), "p99": rank(99)}
    need(summary["count"] == len(codes), f"{place}: count {summary['count']}, expected {len(codes)}")
    for member, code in expected.items():
        got, want = summary[member], metres(code)
        need(got == want or None not in (got, want) and math.isclose(got, want, rel_tol=1e-7),
             f"{place}: {member} {got}, expected {want}")
    buckets = {}
    for code in codes:
        buckets[code >> 6] = buckets.get(code >> 6, 0) + 1
    need({b: c for b, c in summary["histogram"]} == buckets, f"{place}: histogram")


# ---- All together -----------------------------------------------------------------------------

tiles_at = {}  # (level, x, y): Tile


def decode_tile(tile, header, chunks):
    parent = tiles_at[tile.level - 1, tile.x // 2, tile.y // 2] if tile.level else None
    parts, at = [], tile.offset
    for what, length, crc in zip(("heights", "mask", "errors"), tile.lengths, tile.crcs):
        parts.append(chunks[at:at + length])
        check_crc(parts[-1], crc, f"tile {tile.name()} {what}")
        at += length
    lattices = decode_validity(tile, parts[1], header.t, parent)
    tile.valid = lattices[-1]
    decode_heights(tile, parts[0], header, parent, lattices)
    decode_errors(tile, parts[2], header)
    if parent:
        check_against_parent(tile, parent, header)
    if tile.flags & 1:  # 6: valid samples lie in the range of the index
        lows = tile.lows or array("I", bytes(4 * len(tile.codes)))
        shown = [(c, l) for c, l, v in zip(tile.codes, lows, tile.valid) if v]
        for height in (header.metres(*min(shown)), header.metres(*max(shown))):
            need(tile.low <= height <= tile.high, f"tile {tile.name()}: {height} m beyond {tile.low}..{tile.high}")


def outputs(tile):
    """The bytes whose sums are printed: heights, validity, errors."""
    heights = little(array("i", [c if v else 0 for c, v in zip(tile.codes, tile.valid)]))
    if tile.lows is not None:
        heights += little(array("I", [c if v else 0 for c, v in zip(tile.lows, tile.valid)]))
    return heights, bytes(tile.valid), tile.drawable + little(tile.v) + little(tile.h)


def add_to_raster(raster, tile, header):
    """Valid samples of a tile of level L, in the source's own numbers."""
    need(tile.level == header.depth or tile.children, f"tile {tile.name()}: a leaf above level L, no raster")
    if tile.level < header.depth:
        return
    side, exact = header.t + 1, SOURCE_TYPES[header.source] not in "fd"
    lows = tile.lows or array("I", bytes(4 * len(tile.codes)))
    for b in range(side):
        r = tile.y * header.t + b
        for a in range(side):
            c = tile.x * header.t + a
            if tile.valid[b * side + a]:
                need(c < header.w and r < header.h, f"tile {tile.name()}: a valid sample outside the raster")
                value = header.value(tile.codes[b * side + a], lows[b * side + a])
                raster[r * header.w + c] = nearest(value) if exact else value


def nearest(value):
    """2: to the nearest whole number, halves away from zero."""
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


# ---- 16. Imagery ------------------------------------------------------------------------------

class Imagery:
    """Header, prefix and index of the imagery layer; `tiles` in storage order."""

    def __init__(self, sections):
        data = bytes(sections[16][1])
        need(len(data) >= 24, "imagery: cut off")
        (self.t, self.g, self.codec, self.quality, self.channels, flags, self.leaf, self.count, root,
         prefix) = struct.unpack_from("<HBBBBBBQII", data)
        self.side = self.t + 2 * self.g
        need(64 <= self.t <= 4096 and self.t % 4 == 0, f"imagery: tiles of {self.t} texels")
        need(self.g <= 16 and self.side % 4 == 0, f"imagery: gutter {self.g}")
        need(1 <= self.codec <= 5, f"imagery: codec {self.codec} is not known")
        need(1 <= self.quality <= 100 if self.codec == 1 else self.quality == 0, f"imagery: quality {self.quality}")
        need(self.channels in (1, 3), f"imagery: {self.channels} channels")
        need(flags < 2 and self.leaf <= 30 and self.count, "imagery: flags, leaf level or tile count")
        need(24 + root + prefix == len(data), "imagery: another length")
        need(bool(prefix) == (self.codec == 1) and prefix <= 4096, "imagery: JPEG prefix")
        self.prefix = data[24 + root:]
        self.clear = flags & 1
        pages, chunks = sections[17][1], sections[18][1]
        self.tiles, refers = self.read_page(data[24:24 + root], "imagery root page", 0, 0, 0)
        waiting, extents = [(r, len(pages)) for r in refers], []
        while waiting:
            ((level, x, y), offset, length, crc), limit = waiting.pop()
            place = f"imagery page {level}/{x}/{y}"
            need(offset + length <= limit, f"{place}: does not end before the page that refers to it")
            extents.append((offset, offset + length))
            check_crc(pages[offset:offset + length], crc, place)
            more, refers = self.read_page(pages[offset:offset + length], place, level, x, y)
            self.tiles += more
            waiting += [(r, offset) for r in refers]
        need(len(self.tiles) == self.count, f"imagery: {len(self.tiles)} tiles, the header says {self.count}")
        check_tiling(extents, 0, len(pages), "imagery pages")
        self.tiles.sort(key=lambda tile: (tile.level, hilbert(tile)))
        at = 0
        for tile in self.tiles:
            need(tile.offset == at, f"imagery tile {tile.name()}: chunks at {tile.offset}, expected at {at}")
            at += sum(tile.lengths)
        need(at == len(chunks), f"imagery tiles: {len(chunks)} bytes, its chunks have {at}")
        need(self.tiles[-1].level == self.leaf, "imagery: no tile at the leaf level")
        self.chunks = chunks

    def json(self):
        tiles = []
        for tile in self.tiles:
            colour, alpha = self.decode(tile)
            sums = {name: part and hashlib.sha256(part).hexdigest()
                    for name, part in (("colour_sha256", colour), ("alpha_sha256", alpha))}
            first = {} if colour is None else {"first_texels": list(colour[:6 * self.channels])}
            tiles.append({"tile": tile.name(), "children": tile.children, **sums, **first})
        return {"tile": self.t, "gutter": self.g, "codec": self.codec, "quality": self.quality,
                "channels": self.channels, "flags": self.clear, "leaf_level": self.leaf, "tile_count": self.count,
                "tiles": tiles}

    def read_page(self, stored, place, level, x, y):
        data = frame(stored, 1 << 20, place)
        need(len(data) >= 16, f"{place}: too short")
        got_level, depth, reserved, got_x, got_y, n = struct.unpack_from("<BBHIII", data)
        need((got_level, got_x, got_y, reserved) == (level, x, y, 0), f"{place}: holds {got_level}/{got_x}/{got_y}")
        need(depth == page_depth(level, self.leaf) and 1 <= n <= 341, f"{place}: {depth} levels, {n} tiles")
        at = 16

        def column(letter, count):
            nonlocal at
            size = struct.calcsize(f"<{count}{letter}")
            need(at + size <= len(data), f"{place}: cut off")
            at += size
            return struct.unpack_from(f"<{count}{letter}", data, at - size)

        columns = [column(letter, n) for letter in "BQIIII"]
        tiles, here = [], [(level, x, y)]
        for l in range(level, level + depth):
            need(len(tiles) + len(here) <= n, f"{place}: more tiles than {n}")
            below = []
            for position in here:
                tile = Tile()
                tile.level, tile.x, tile.y = position
                tile.children, tile.offset, *rest = (c[len(tiles)] for c in columns)
                tile.lengths, tile.crcs = rest[:2], rest[2:]
                need(tile.children < 16 and tile.lengths[0], f"imagery tile {tile.name()}: children or colour")
                need(tile.level < self.leaf or not tile.children, f"imagery tile {tile.name()}: children below")
                below += [(l + 1, 2 * tile.x + (q & 1), 2 * tile.y + (q >> 1)) for q in range(4)
                          if tile.children >> q & 1]
                tiles.append(tile)
            here = below
        need(len(tiles) == n, f"{place}: {n} tiles, its children bits say {len(tiles)}")
        refers = list(zip(here, *(column(letter, len(here)) for letter in "QII")))
        need(at == len(data), f"{place}: {len(data) - at} bytes too many")
        return tiles, refers

    def decode(self, tile):
        """16.3: (colour or None where no decoder is at hand, alpha), a byte a channel."""
        place = f"imagery tile {tile.name()}"
        first, last = tile.offset + tile.lengths[0], tile.offset + sum(tile.lengths)
        colour, alpha = bytes(self.chunks[tile.offset:first]), bytes(self.chunks[first:last])
        check_crc(colour, tile.crcs[0], f"{place}, colour")
        check_crc(alpha, tile.crcs[1], f"{place}, alpha")
        need(not alpha or self.codec in (1, 4, 5), f"{place}: an alpha chunk")
        opaque = b"\xff" * self.side ** 2
        if self.codec == 3:
            return decode_png(colour, self.side, self.channels, place)
        alpha = self.decode_alpha(alpha, place) if alpha else opaque
        if self.codec == 1:
            return decode_picture(self.prefix + colour + b"\xff\xd9", self.side, self.channels, place)[0], alpha
        if self.codec == 2:
            return decode_picture(colour, self.side, self.channels, place)
        size = (self.side // 4) ** 2 * (16 if self.codec == 4 else 8)
        blocks = frame(colour, size, place)
        need(len(blocks) == size, f"{place}: {len(blocks)} bytes of blocks, expected {size}")
        return None, alpha

    def decode_alpha(self, chunk, place):
        side, form = self.side, chunk[0]
        need(form < 2, f"{place}: alpha of form {form}")
        size = side * side if form == 0 else (side * side + 7) // 8
        changes = frame(chunk[1:], size, place)
        need(len(changes) == size, f"{place}: {len(changes)} bytes of alpha")
        if form == 1:
            changes = bytes(255 * bit for bit in take_bits(changes, side * side, place))
        out = bytearray(b"\xff" * side)
        for i, change in enumerate(changes):
            out.append(out[i] ^ change if form == 1 else (out[i] + change) & 255)
        return bytes(out[side:])


def decode_png(data, side, channels, place):
    """A PNG of 8 bits without interlacing, by hand."""
    need(data[:8] == b"\x89PNG\r\n\x1a\n", f"{place}: not a PNG")
    at, packed = 8, b""
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"IHDR":
            width, height, depth, colour, _, _, interlaced = struct.unpack_from(">IIBBBBB", data, at + 8)
        elif kind == b"IDAT":
            packed += data[at + 8:at + 8 + length]
        at += 12 + length
    need((width, height, depth, interlaced) == (side, side, 8, 0), f"{place}: another PNG")
    has_alpha = colour in (4, 6)
    need(colour & 3 == (2 if channels == 3 else 0), f"{place}: colour type {colour}")
    size = channels + has_alpha
    raw, rows, above = zlib.decompress(packed), bytearray(), bytearray(side * size)
    need(len(raw) == side * (side * size + 1), f"{place}: {len(raw)} bytes of pixels")
    for y in range(side):
        start = y * (side * size + 1)
        method, row = raw[start], bytearray(raw[start + 1:start + 1 + side * size])
        for i in range(len(row)):
            a = row[i - size] if i >= size else 0
            b, c = above[i], above[i - size] if i >= size else 0
            p = a + b - c
            nearest = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            row[i] = (row[i] + (0, a, b, (a + b) // 2, nearest)[method]) & 255
        rows += row
        above = row
    if not has_alpha:
        return bytes(rows), b"\xff" * side ** 2
    alpha = bytes(rows[channels::size])
    return bytes(b for i, b in enumerate(rows) if i % size != channels), alpha


def decode_picture(data, side, channels, place):
    """A JPEG or WebP by Pillow, if it is there."""
    try:
        from PIL import Image
    except ImportError:
        return None, None
    import io
    try:
        picture = Image.open(io.BytesIO(data))
        need(picture.size == (side, side), f"{place}: a picture of {picture.size}")
        rgba = picture.convert("RGBA")
    except (OSError, ValueError) as e:
        raise Violation(f"{place}: {e}") from None
    bands = [band.tobytes() for band in rgba.split()]
    colour = bands[0] if channels == 1 else bytes(b for pixel in zip(*bands[:3]) for b in pixel)
    return colour, bands[3]


def list_imagery(sections):
    """A line per tile: imagery level/x/y children sha256(colour) sha256(alpha), a dash for what cannot be decoded."""
    imagery = Imagery(sections)
    print("imagery", imagery.t, imagery.g, imagery.codec, imagery.channels, imagery.clear, imagery.leaf, imagery.count)
    for tile in imagery.tiles:
        parts = imagery.decode(tile)
        sums = ("-" if part is None else hashlib.sha256(part).hexdigest() for part in parts)
        print("imagery", tile.name(), tile.children, *sums)


def tile_json(tile, header):
    """A tile: its row of the index, the sums of what it decodes to, its first rows."""
    side, steps = header.t + 1, header.steps
    patches = (header.t // header.p) ** 2
    rows = side if tile.level == 0 and side <= 33 else 2
    lows = tile.lows or array("I", bytes(4 * len(tile.codes)))

    def grid(value):
        return [[value(b * side + a) if tile.valid[b * side + a] else None for a in range(side)] for b in range(rows)]
    heights, valid, errors = (hashlib.sha256(part).hexdigest() for part in outputs(tile))
    out = {"tile": tile.name(), "children": tile.children, "flags": tile.flags, "vertical": tile.vertical,
           "horizontal": tile.horizontal, "min_m": float_json(tile.low), "max_m": float_json(tile.high),
           "offset": tile.offset, "lengths": tile.lengths,
           "heights_sha256": heights, "valid_sha256": valid, "errors_sha256": errors,
           "codes": grid(lambda at: tile.codes[at]),
           "values": grid(lambda at: float_json(header.value(tile.codes[at], lows[at])))}
    if tile.lows is not None:
        out["lows"] = grid(lambda at: tile.lows[at])
    out["drawable"] = list(tile.drawable)
    for name, codes in (("vertical_codes", tile.v), ("horizontal_codes", tile.h)):
        shown = range(steps) if tile.level == 0 else range(steps - 1, steps)
        out[name] = {str(k): list(codes[k * patches:(k + 1) * patches]) for k in shown}
    return out


def print_json(header, metadata, statistics, tiles, sections):
    """One member to a line, and one tile: so that a difference can be seen."""
    def line(value):
        return json.dumps(value, allow_nan=False, separators=(",", ":"))
    members = [("header", header.json()), ("metadata", metadata), ("statistics", statistics)]
    if 16 in sections:
        members.append(("imagery", Imagery(sections).json()))
    for name, value in members:
        print(("{" if name == "header" else ",") + json.dumps(name) + ":" + line(value))
    print(",\"tiles\":[")
    print(",\n".join(line(tile_json(tile, header)) for tile in tiles))
    print("]}")


def run(options, path):
    with open(path, "rb") as f:
        data = f.read()
    header = Header(data)
    sections = read_sections(data, header)
    metadata = read_json(sections[1][1], "metadata")
    statistics = read_json(frame(sections[3][1], 64 << 20, "statistics"), "statistics") if 3 in sections else None
    tiles = read_index(sections, header)
    tiles_at.clear()
    tiles_at.update(((tile.level, tile.x, tile.y), tile) for tile in tiles)
    raster = None
    if options.raster:
        letter = SOURCE_TYPES[header.source]
        no_value = math.nan if letter in "fd" else 0
        try:
            void = array(letter, [type(no_value)(header.nodata) if header.has_nodata else no_value])
        except (OverflowError, ValueError):  # a nodata value that is none of the type's: no sample can have it
            void = array(letter, [no_value])
        raster = void * (header.w * header.h)
    for tile in tiles:
        if options.level is not None and tile.level > options.level:
            break
        decode_tile(tile, header, sections[5][1])
        if raster is not None:
            add_to_raster(raster, tile, header)
        if options.level in (None, tile.level) and not options.json:
            parts = outputs(tile)
            sums = (hashlib.sha256(part).hexdigest() for part in parts)
            print(tile.name(), tile.children, tile.flags, *sums)
            for what, part in zip(("heights", "valid", "errors"), parts) if options.dump else ():
                name = f"{tile.level}_{tile.x}_{tile.y}.{what}"
                with open(os.path.join(options.dump, name), "wb") as f:
                    f.write(part)
    if statistics is not None and options.level is None:
        try:
            check_statistics(statistics, tiles, header)
        except (LookupError, TypeError, ValueError, AttributeError) as e:
            raise Violation(f"statistics: a member is missing or odd ({e!r})") from None
    if options.json:
        print_json(header, metadata, statistics, tiles, sections)
    elif 16 in sections and options.level is None:
        list_imagery(sections)
    if raster is not None:
        with open(options.raster, "wb") as f:
            f.write(little(raster))


def main():
    parser = argparse.ArgumentParser(description="Decodes a .rlv file and prints a line per tile.")
    parser.add_argument("file", nargs="+", help="with more than one, each is named before its lines")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    parser.add_argument("--level", type=int, help="print this level only, and go no deeper")
    parser.add_argument("--dump", metavar="DIR", help="write what is summed to DIR/level_x_y.heights, .valid, .errors")
    parser.add_argument("--raster", metavar="OUT", help="write all samples, little-endian, in the source's type")
    options = parser.parse_args()
    for path in options.file:
        if len(options.file) > 1:
            print(path)
        try:
            run(options, path)
        except Violation as e:
            sys.exit(f"{path}: {e}")  # exit code 1
        except OverflowError as e:
            sys.exit(f"{path}: heights do not fit the source type: {e}")


if __name__ == "__main__":
    main()
