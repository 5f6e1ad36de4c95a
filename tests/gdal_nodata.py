#!/usr/bin/python3
"""Writes fixtures/nodata.txt: which samples GDAL takes for nodata, for every type and many spellings.

    python3 tests/gdal_nodata.py > fixtures/nodata.txt        (GDAL 3.6.2)

A line: type, text of the tag, GDAL's value of it (hexadecimal float), then the samples (bits, hexadecimal) that are
void to GDAL's mask band, and after `|` those that are not.
"""

import struct
import sys

import numpy as np
from osgeo import gdal

gdal.UseExceptions()
TYPES = {
    "Byte": ("B", 1), "UInt16": ("H", 1), "Int16": ("h", 2), "UInt32": ("I", 1), "Int32": ("i", 2),
    "Float32": ("f", 3), "Float64": ("d", 3),
}
TEXTS = [
    "0", "-0", "0.0", "1", "-1", "255", "256", "-9999", "-9999.0", "-9999.5", "-9999.4999", "-32768", "-32768.4",
    "-32767.6", "-32768.6", "-32769", "32767", "32768", "32767.4", "32767.5", "65535", "65535.4", "65535.6", "65536",
    "0.4", "0.5", "0.6", "-0.4", "-0.6", "254.6", "255.4", "255.6", "2147483647", "2147483647.4", "2147483648",
    "-2147483648", "-2147483648.4", "-2147483649", "4294967295", "4294967295.4", "4294967296", "1e20", "-1e20", "1e300",
    "-1e300", "-3.4e+38", "-3.40282e+38", "-3.402823e+38", "-3.4028235e+38", "-3.40282347e+38",
    "-3.402823466385289e+38", "-3.4028234663852886e+38", "-3.40282306073709652508e+38", "-3.4028231e+38",
    "3.4e+38", "3.4028235e+38", "3.402823466e+38", "-3.5e+38", "1.17549435e-38", "1.175494351e-38", "2.2250738585072014e-308",
    "-1.7976931348623157e+308", "-1.7976931348623158e+308", "-1.797693e+308", "1.79769313486231571e+308", "0.1",
    "0.10000000149011612", "0.1000001", "-99999.9", "-99999.8984375", "9.96921e+36", "9.9692099683868690e+36", "1e-40", "5e-324",
    "nan", "-nan", "inf", "-inf", "-1.#IND", "1,5", "1.5", " -9999", "-9999 m", "12345678.9", "16777217", "-123456.789",
]

# Texts that say nothing more of floats.
INTEGERS = [
    "-0", "0.0", "255", "256", "-9999.0", "-9999.5", "-32767.6", "-32768.6", "-32769", "32768", "32767.4", "32767.5", "65535.4",
    "65535.6", "65536", "0.4", "0.6", "-0.6", "254.6", "255.4", "255.6", "2147483647.4", "2147483648", "-2147483648.4",
    "4294967295", "4294967295.4", "-2147483649", "-1",
]


def samples(name, value):
    """Samples that could be taken for a value, and some that could not."""
    code, _ = TYPES[name]
    if name not in ("Float32", "Float64"):
        info = np.iinfo(code)
        around = [] if not np.isfinite(value) else [int(value) + d for d in (-2, -1, 0, 1, 2)]
        return [v for v in sorted({0, 1, int(info.max), int(info.min)} | set(around)) if info.min <= v <= info.max]
    kind = np.float32 if name == "Float32" else np.float64
    with np.errstate(all="ignore"):
        found = [kind(v) for v in (0.0, -0.0, 1.0, -9999.0, 100.25, 3.0, -3.0)]
        info = np.finfo(kind)
        found += [info.max, -info.max, info.tiny, -info.tiny, kind(3.0e38), kind(-3.0e38), kind(-1e30), kind(-1e35)]
        if name == "Float64":
            found += [float(np.finfo(np.float32).max), -float(np.finfo(np.float32).max), -1e308, -1e303]
        centre = kind(value)
        if np.isfinite(centre):
            for step in range(-9, 10):
                if name == "Float64":
                    found.append(centre * (1.0 + step * 2.0 ** -24))
                    continue
                at = centre
                for _ in range(abs(step)):
                    at = np.nextafter(at, kind(np.sign(step) * np.inf))
                found.append(at)
        found += [kind(float("nan"))]
    return [v for v in found if np.isnan(v) or np.isfinite(v)]


def tiff(name, text, values):
    """The bytes of a TIFF of one row, with a nodata text."""
    code, form = TYPES[name]
    size = struct.calcsize(code)
    ascii_ = text.encode() + b"\0"
    tags = [(256, 4, 1, len(values)), (257, 4, 1, 1), (258, 3, 1, 8 * size), (259, 3, 1, 1), (262, 3, 1, 1),
            (273, 4, 1, 0), (277, 3, 1, 1), (278, 4, 1, 1), (279, 4, 1, size * len(values)), (339, 3, 1, form),
            (42113, 2, len(ascii_), 0)]
    front = 8 + 2 + 12 * len(tags) + 4
    at = front + (len(ascii_) + 7) // 8 * 8
    out = b"II*\0" + struct.pack("<IH", 8, len(tags))
    for tag, kind, count, value in tags:
        value = at if tag == 273 else front if tag == 42113 else value
        field = struct.pack("<I", value) if kind != 3 else struct.pack("<HH", value, 0)
        if tag == 42113 and count <= 4:
            field = ascii_.ljust(4, b"\0")
        out += struct.pack("<HHI", tag, kind, count) + field
    out += b"\0\0\0\0" + ascii_.ljust(at - front, b"\0")
    return out + b"".join(struct.pack("<" + code, v) for v in values)


def main():
    print("# GDAL", gdal.VersionInfo("RELEASE_NAME"), "by tests/gdal_nodata.py")
    for name, (code, _) in TYPES.items():
        size = struct.calcsize(code)
        for text in TEXTS:
            if (text in INTEGERS) if code in "fd" else ("e+3" in text):
                continue
            gdal.FileFromMemBuffer("/vsimem/a.tif", tiff(name, text, [0]))
            dataset = gdal.Open("/vsimem/a.tif")
            value = dataset.GetRasterBand(1).GetNoDataValue()
            values = samples(name, value if value is not None else float("nan"))
            gdal.FileFromMemBuffer("/vsimem/a.tif", tiff(name, text, values))
            dataset = gdal.Open("/vsimem/a.tif")
            mask = dataset.GetRasterBand(1).GetMaskBand().ReadAsArray()[0]
            sets = {True: [], False: []}
            for v, m in zip(values, mask):
                bits = struct.pack(">" + code, v).hex()
                if bits not in sets[bool(m == 0)]:
                    sets[bool(m == 0)].append(bits)
            print(name, text.replace(" ", "_"), "none" if value is None else float(value).hex(), *sets[True], "|", *sets[False])


sys.exit(main())
