"""A large raster of real terrain: crops of real tiles, turned and mirrored, side by side.

    mosaic.py FOLDER_OF_TILES SIDE OUT.tif

Takes every int16 raster of the folder that is large enough. Which crop goes where is a fixed pseudorandom choice.
"""

import array
import json
import os
import subprocess
import sys
import tempfile

CROP = 1200
NODATA = -32768


def crops(folder, work):
    """The north-western CROP x CROP samples of every tile, row by row, with voids as NODATA whatever the tile calls them."""
    found = []
    for name in sorted(os.listdir(folder)):
        path = os.path.join(folder, name)
        info = subprocess.run(["gdalinfo", "-json", path], capture_output=True, text=True)
        if info.returncode != 0:
            continue
        info = json.loads(info.stdout)
        if min(info["size"]) < CROP or not info["bands"] or info["bands"][0]["type"] != "Int16":
            continue
        raw = os.path.join(work, "crop.bin")
        window = ["-srcwin", "0", "0", str(CROP), str(CROP)]
        command = ["gdal_translate", "-q", "-of", "ENVI", "-b", "1", *window, path, raw]
        subprocess.run(command, check=True)
        samples = array.array("h")
        with open(raw, "rb") as file:
            samples.frombytes(file.read())
        void = info["bands"][0].get("noDataValue", NODATA)
        if void != NODATA:
            samples = array.array("h", (NODATA if sample == void else sample for sample in samples))
        found.append(samples)
    if not found:
        sys.exit(f"mosaic.py: no int16 raster of at least {CROP} x {CROP} in {folder}")
    return found


def rows(samples, turn):
    """The rows of a crop, turned and mirrored in one of eight ways."""
    if turn & 1:
        lines = [samples[column::CROP] for column in range(CROP)]
    else:
        lines = [samples[row * CROP : (row + 1) * CROP] for row in range(CROP)]
    if turn & 2:
        lines.reverse()
    return [line[::-1] for line in lines] if turn & 4 else lines


def main():
    folder, side, out = sys.argv[1], int(sys.argv[2]), sys.argv[3]
    seed = 1
    with tempfile.TemporaryDirectory(dir=os.path.dirname(out)) as work:
        tiles = crops(folder, work)
        raw = os.path.join(work, "mosaic.bin")
        with open(raw, "wb") as file:
            for top in range(0, side, CROP):
                band = []
                for _ in range(0, side, CROP):
                    seed = (seed * 1664525 + 1013904223) % 2**32
                    band.append(rows(tiles[(seed >> 16) % len(tiles)], seed >> 8 & 7))
                for y in range(min(CROP, side - top)):
                    line = array.array("h")
                    for lines in band:
                        line.extend(lines[y])
                    file.write(line[:side].tobytes())
        order = 0 if sys.byteorder == "little" else 1
        with open(os.path.join(work, "mosaic.hdr"), "w", encoding="ascii") as file:
            file.write(f"ENVI\nsamples = {side}\nlines = {side}\nbands = 1\ndata type = 2\n")
            file.write(f"interleave = bsq\nbyte order = {order}\nheader offset = 0\n")
        place = ["-a_srs", "EPSG:32632", "-a_ullr", "0", str(30 * side), str(30 * side), "0"]
        big = ["-co", "BIGTIFF=IF_SAFER", "-a_nodata", str(NODATA)]
        subprocess.run(["gdal_translate", "-q", *place, *big, raw, out], check=True)


main()
