"""Writes BENCHMARKS.md and docs/scaling.svg from the results of bench/run.sh.

    report.py ROOT DATA
"""

import json
import math
import os
import statistics
import sys

ABOUT = {
    "int16": "synthetic int16 terrain without voids (`examples/synth`), uncompressed strips",
    "float32": "synthetic float32 terrain, uncompressed strips",
    "mosaic": "crops of real SRTM tiles, turned and mirrored, with their voids; int16, uncompressed",
}


def load(data):
    folder = os.path.join(data, "results")
    results = {}
    for name in sorted(os.listdir(folder)):
        if name.endswith(".json"):
            with open(os.path.join(folder, name), encoding="utf-8") as file:
                results[name[:-5]] = json.load(file)
    machine = results.pop("machine", None)
    if not results or machine is None:
        sys.exit(f"report.py: no results in {folder}; run bench/run.sh first")
    # Kind by kind, the small ones first; a variant after what it was made from.
    order = sorted(results.values(), key=lambda r: (r["case"].split("-")[0] != "int16", r["case"].split("-")[0], r["width"], r["case"]))
    return machine, order


def median(result, name, what):
    values = [run[what] for run in result["runs"].get(name, []) if what in run]
    return statistics.median(values) if values else None


def cell(value, form="{:.2f}"):
    return "" if value is None else form.format(value)


def ratio(a, b):
    return None if not a or not b else a / b


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|---" + "|--:" * (len(head) - 1) + "|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def samples(result):
    return result["width"] * result["height"]


def building(results):
    rows = []
    for r in results:
        ours, one, theirs, fast = (median(r, name, "wall") for name in ("relevo-2", "relevo-1", "gdal", "gdal-fast"))
        speed = lambda seconds: samples(r) / seconds / 1e6 if seconds else None
        rows.append([
            r["case"], f"{samples(r) / 1e6:.1f}", cell(ours), cell(one), cell(theirs), cell(fast), cell(ratio(ours, theirs)),
            cell(ratio(ours, fast)), cell(speed(ours), "{:.1f}"), cell(speed(theirs), "{:.1f}"), str(len(r["runs"]["relevo-2"])),
        ])
    head = ["raster", "Msamples", "relevo 2 jobs, s", "relevo 1 job, s", "GDAL 2 threads, s", "GDAL level 1, s"]
    return table([*head, "relevo 2 : GDAL", ": level 1", "relevo, Msamples/s", "GDAL, Msamples/s", "runs"], rows)


def processor(results):
    rows = []
    for r in results:
        row = [r["case"]]
        for name in ("relevo-2", "relevo-1", "gdal", "gdal-fast"):
            row += [cell(median(r, name, "user")), cell(median(r, name, "sys"))]
        rows.append(row)
    head = [f"{name}, {what} s" for name in ("relevo 2", "relevo 1", "GDAL", "level 1") for what in ("user", "sys")]
    return table(["raster", *head], rows)


def space(results):
    rows = []
    for r in results:
        mib = [median(r, name, "rss_kib") for name in ("relevo-2", "relevo-1", "gdal")]
        ours, theirs, fast = (median(r, name, "bytes") for name in ("relevo-2", "gdal", "gdal-fast"))
        row = [r["case"], *(cell(kib and kib / 1024, "{:.0f}") for kib in mib), cell(ratio(mib[0], mib[2]))]
        row += [cell(r["source_bytes"] / 1e6, "{:.1f}"), cell(ours and ours / 1e6), cell(theirs and theirs / 1e6)]
        row += [cell(fast and fast / 1e6), cell(ratio(ours, theirs))]
        rows.append([*row, cell(ours and 8 * ours / samples(r))])
    head = ["raster", "relevo 2, MiB", "relevo 1, MiB", "GDAL, MiB", "relevo 2 : GDAL", "DEM, MB", "rlv, MB", "COG, MB", "COG level 1, MB"]
    return table([*head, "rlv : COG", "rlv, bits/sample"], rows)


def decoding(results):
    rows = []
    for r in results:
        one, two, build = (median(r, name, "wall") for name in ("decode-1", "decode-2", "relevo-2"))
        cpu = median(r, "decode-1", "user"), median(r, "decode-1", "sys")
        cpu = None if None in cpu else sum(cpu)
        rows.append([r["case"], cell(one), cell(two), cell(cpu), cell(ratio(build, two)), cell(median(r, "decode-2", "rss_kib") and median(r, "decode-2", "rss_kib") / 1024, "{:.0f}")])
    head = ["raster", "1 thread, s", "2 threads, s", "processor (1 thread), s", "build : decode, 2 threads", "memory, MiB"]
    return table(head, rows)


def reading(results):
    rows = []
    for r in results:
        reader = r["reader"]
        if not reader:
            continue
        speeds = {s["threads"]: s["samples_per_second"] / 1e6 for s in reader["sequential"]}
        row = [r["case"], str(reader["tiles"]), f"{reader['open_ms']:.2f}", f"{reader['open_resident_mb']:.1f}"]
        row += [f"{reader[name]:.2f}" for name in ("cold_leaf_ms", "cold_leaf_worst_ms", "leaf_alone_ms", "leaf_alone_worst_ms")]
        rows.append([*row, cell(speeds.get(1), "{:.0f}"), cell(speeds.get(2), "{:.0f}")])
    head = ["file of", "tiles", "open, ms", "resident, MB", "cold leaf, ms", "worst, ms", "alone, ms", "worst, ms"]
    return table([*head, "all leaves, 1 thread, Msamples/s", "2 threads"], rows)


class Chart:
    """Two panels with logarithmic axes."""

    COLOURS = {"relevo-2": "#0b6e4f", "relevo-1": "#7fb069", "gdal": "#b5442e"}
    NAMES = {"relevo-2": "relevo, 2 jobs", "relevo-1": "relevo, 1 job", "gdal": "GDAL COG, 2 threads"}
    WIDTH, HEIGHT, LEFT, TOP = 380, 300, 70, 50

    def __init__(self):
        self.parts = []

    def text(self, x, y, text, anchor="middle", size=12):
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}">{text}</text>')

    def line(self, x1, y1, x2, y2):
        self.parts.append(f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="#ddd"/>')

    def panel(self, at, title, series):
        points = [point for line in series.values() for point in line]
        left = self.LEFT + at * (self.WIDTH + self.LEFT + 20)
        low_x, high_x = (f(math.log10(x) for x, _ in points) for f in (min, max))
        low_y = math.floor(min(math.log10(y) for _, y in points))
        high_y = max(math.ceil(max(math.log10(y) for _, y in points)), low_y + 1)
        pad = 0.05 * (high_x - low_x) + 0.05
        low_x, high_x = low_x - pad, high_x + pad
        place_x = lambda x: left + (math.log10(x) - low_x) / (high_x - low_x) * self.WIDTH
        place_y = lambda y: self.TOP + (high_y - math.log10(y)) / (high_y - low_y) * self.HEIGHT
        self.text(left + self.WIDTH / 2, self.TOP - 16, title, size=14)
        for power in range(low_y, high_y + 1):
            y = place_y(10.0**power)
            self.line(left, y, left + self.WIDTH, y)
            self.text(left - 6, y + 4, f"{10.0**power:g}", "end")
        for x in sorted({x for x, _ in points}):
            self.line(place_x(x), self.TOP, place_x(x), self.TOP + self.HEIGHT)
            self.text(place_x(x), self.TOP + self.HEIGHT + 16, f"{math.isqrt(x)}²", size=11)
        self.text(left + self.WIDTH / 2, self.TOP + self.HEIGHT + 34, "samples")
        for name, line in series.items():
            colour = self.COLOURS[name]
            path = "L".join(f"{place_x(x):.1f} {place_y(y):.1f}" for x, y in line)
            self.parts.append(f'<path d="M{path}" fill="none" stroke="{colour}" stroke-width="2"/>')
            for x, y in line:
                self.parts.append(f'<circle cx="{place_x(x):.1f}" cy="{place_y(y):.1f}" r="3.5" fill="{colour}"/>')

    def svg(self):
        width, height = 2 * (self.WIDTH + self.LEFT + 20) + 20, self.TOP + self.HEIGHT + 75
        for number, (name, colour) in enumerate(self.COLOURS.items()):
            x, y = self.LEFT + 180 * number, height - 18
            self.parts.append(f'<circle cx="{x}" cy="{y}" r="5" fill="{colour}"/>')
            self.text(x + 12, y + 4, self.NAMES[name], "start")
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif">'
        return "\n".join([head, f'<rect width="{width}" height="{height}" fill="#fff"/>', *self.parts, "</svg>"]) + "\n"


def scaling(results):
    """The chart of the synthetic int16 rasters; None unless there are two."""
    plain = [r for r in results if r["case"].startswith("int16-") and r["case"].count("-") == 1]
    if len(plain) < 2:
        return None
    chart = Chart()
    for at, (title, what, unit) in enumerate([("seconds", "wall", 1), ("peak memory, MiB", "rss_kib", 1024)]):
        series = {}
        for name in Chart.NAMES:
            line = [(samples(r), median(r, name, what)) for r in plain]
            series[name] = [(x, y / unit) for x, y in line if y]
        chart.panel(at, title, {name: line for name, line in series.items() if line})
    return chart.svg()


def main():
    root, data = sys.argv[1], sys.argv[2]
    machine, results = load(data)
    kinds = [kind for kind in ABOUT if any(r["case"].startswith(kind) for r in results)]
    picture = scaling(results)
    timer = machine["hyperfine"] or "a monotonic clock"
    parts = [
        "# Benchmarks\n",
        "Written by `bench/run.sh`; do not edit. Every figure is the median of the runs in its row; the programs ran in turn.\n",
        f"- Machine: {machine['cpu']}, {machine['cores']} processors, {machine['ram_gib']} GiB of memory",
        f"- System: {machine['os']}, kernel {machine['kernel']}",
        f"- Versions: {machine['relevo']}, {machine['rustc']}, {machine['gdal']}",
        f"- Wall time by {timer}, processor time and peak resident memory by GNU time; measured {machine['date']}\n",
        "Rasters:\n",
        *(f"- `{kind}-SIDE`: {ABOUT[kind]}" for kind in kinds),
        "- `-deflate`, `-zstd`: the same in tiles of 256 x 256, with predictor 2\n",
        "Both programs write every level of a pyramid losslessly with zstd; relevo computes and stores a geometric error for every "
        "patch and step besides. GDAL runs at its usual level of zstd, 9, and at its fastest, `LEVEL=1`. The DEM is read once before each run, so that it is in the page cache as far as it fits.\n",
        "## Building\n", building(results),
    ]
    if picture:
        with open(os.path.join(root, "docs", "scaling.svg"), "w", encoding="utf-8") as file:
            file.write(picture)
        parts.append("![Seconds and peak memory over the number of samples, relevo and GDAL](docs/scaling.svg)\n")
    with open(os.path.join(root, "bench", "replayed.md"), encoding="utf-8") as file:
        replayed = file.read()
    parts += [
        "Processor time:\n", processor(results),
        "## Memory and sizes\n", space(results),
        "## Decoding the source alone\n",
        "`examples/decode_only` reads all rows in bands of 257 with the reader that the builder uses, and does nothing with them.\n",
        decoding(results),
        "## Reading\n",
        "`examples/read_bench`: a cold leaf is decoded with all of its ancestors by a reader that has decoded nothing "
        "(median and worst of some 64); alone by `read_tile_alone`, which keeps no ancestor and decodes only what the leaf needs of them; all leaves are read once in storage order, counted in samples of the raster.\n",
        reading(results),
        replayed,
        "## How to repeat\n",
        "```sh\nbench/run.sh --data DIR [--tiles FOLDER_OF_SRTM_TILES]\n```\n",
        "The commands, for the first raster:\n",
        "```sh", *results[0]["commands"].values(), "```\n",
    ]
    with open(os.path.join(root, "BENCHMARKS.md"), "w", encoding="utf-8") as file:
        file.write("\n".join(parts))
    print(f"written: {os.path.join(root, 'BENCHMARKS.md')}", file=sys.stderr)


main()
