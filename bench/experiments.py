#!/usr/bin/env python3
"""The experiments of the papers, repeated: writes EXPERIMENTS.md and docs/experiments-*.svg.

    bench/experiments.py [--data DIR] [--mosaic DEM...] [--side N] [--frames N] [--size WxH] [--adapter NAME] [--report-only]

--data DIR       where rasters, files and results go (target/experiments-data); what is there is not made again
--mosaic DEM...  adjoining real DEMs; without them the bundled DEM of Colorado is used
--side N         samples along the synthetic terrain (16385)
--frames N       frames of each camera path (16)
--size WxH       pixels of a frame (1280x720)
--adapter NAME   what the viewer draws with (software)
--report-only    write the report from the results that are there

Builds relevo, relevo-viewer and the synthetic terrain first. Every number in the report comes from the viewer's --metrics.
"""

import argparse
import csv
import os
import platform
import statistics
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
TILES = (32, 64, 128, 256, 512)
PATCHES = (16, 32, 64)
COLOURS = ("#c0392b", "#2471a3", "#1e8449", "#b7950b", "#6c3483")


def say(*words):
    print(*words, file=sys.stderr, flush=True)


def run(*command, **options):
    say("$", *command)
    subprocess.run([str(word) for word in command], check=True, **options)


class Lab:
    """Makes files and measures camera paths over them; what has been measured is read back."""

    def __init__(self, args):
        self.args = args
        self.data = os.path.abspath(args.data)
        os.makedirs(self.data, exist_ok=True)
        target = os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target"))
        self.programs = os.path.join(target, "release")

    def build(self):
        run("cargo", "build", "--release", "--locked", "--workspace", "--bins", "--examples", cwd=ROOT)

    def synthetic(self, side, *more):
        path = os.path.join(self.data, f"synthetic-{side}{''.join(more)}.tif")
        if not os.path.exists(path):
            run(os.path.join(self.programs, "examples", "synth"), side, path + ".part.tif", "--compress", "deflate", *more)
            os.replace(path + ".part.tif", path)
        return path

    def file(self, name, dems, tile, patch):
        path = os.path.join(self.data, f"{name}-{tile}-{patch}.rlv")
        if not os.path.exists(path):
            run(os.path.join(self.programs, "relevo"), "build", *dems, "-o", path, "--tile", tile, "--patch", patch, "--progress", "none")
        return path

    def path(self, file, label, *options, observe=True):
        """Rows of one camera path; numbers, or None where a column is empty."""
        table = os.path.join(self.data, f"{os.path.splitext(os.path.basename(file))[0]}-{label}.csv")
        if not os.path.exists(table):
            command = [os.path.join(self.programs, "relevo-viewer"), file, "--headless", "--count", self.args.frames,
                       "--size", self.args.size, "--adapter", self.args.adapter, "--force", "--metrics", table + ".part", *options]
            run(*command, *(["--observe"] if observe else []))
            os.replace(table + ".part", table)
        with open(table, encoding="utf-8", newline="") as file:
            return [{key: float(value) if value else None for key, value in row.items()} for row in csv.DictReader(file)]


def column(rows, name):
    return [row[name] for row in rows if row[name] is not None]


def mean(rows, name):
    values = column(rows, name)
    return statistics.fmean(values) if values else None


def median(rows, name):
    values = column(rows, name)
    return statistics.median(values) if values else None


def most(rows, name):
    values = column(rows, name)
    return max(values) if values else None


def number(value, form="{:.2f}"):
    return "" if value is None else form.format(value)


def table(head, lines):
    out = ["| " + " | ".join(head) + " |", "|---" + "|--:" * (len(head) - 1) + "|"]
    return "\n".join(out + ["| " + " | ".join(line) + " |" for line in lines]) + "\n"


def chart(path, title, series, unit):
    """Lines over the frames of a path."""
    width, height, left, top = 620, 240, 70, 34
    values = [v for line in series.values() for v in line if v is not None]
    if not values:
        return
    peak = max(values) * 1.05 or 1
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width + left + 130} {height + top + 44}" font-family="sans-serif" font-size="12">',
             f'<rect width="100%" height="100%" fill="#fff"/><text x="{left}" y="20" font-size="14">{title}</text>']
    for i in range(5):
        y = top + height * (1 - i / 4)
        parts.append(f'<path d="M{left} {y:.1f}h{width}" stroke="#ddd"/><text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{peak * i / 4:.3g}</text>')
    parts.append(f'<text x="{left + width / 2}" y="{top + height + 30}" text-anchor="middle">frame</text><text x="12" y="{top - 8}">{unit}</text>')
    for at, (name, line) in enumerate(series.items()):
        colour, last = COLOURS[at % len(COLOURS)], max(len(line) - 1, 1)
        points = " ".join(f"{left + width * i / last:.1f},{top + height * (1 - v / peak):.1f}" for i, v in enumerate(line) if v is not None)
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts.append(f'<text x="{left + width + 10}" y="{top + 14 + 18 * at}" fill="{colour}">{name}</text>')
    with open(path, "w", encoding="utf-8") as file:
        file.write("\n".join([*parts, "</svg>"]) + "\n")


def sizes(lab, name, dems, out):
    """Tile sizes by patch sizes, as figures 6 to 10 of paper 001."""
    lines, by_patch = [], {}
    for patch in PATCHES:
        for tile in (t for t in TILES if t >= patch):
            rows = lab.path(lab.file(name, dems, tile, patch), "sizes", "--tolerance", "1")
            by_patch.setdefault(patch, {})[f"tile {tile}"] = rows
            lines.append([f"{tile} / {patch}", number(mean(rows, "triangles"), "{:,.0f}"), number(mean(rows, "patches"), "{:,.0f}"),
                          number(mean(rows, "tiles"), "{:.0f}"), number(most(rows, "tiles"), "{:.0f}"), number(most(rows, "tiles") * 5 * (tile + 1) ** 2 / 2**20, "{:.1f}"),
                          number(median(rows, "select_ms")), number(median(rows, "frame_ms"), "{:.0f}"),
                          number(most(rows, "promised_px"), "{:.3f}"), number(most(rows, "observed_px"), "{:.3f}")])
    out.append(table(["tile / patch", "triangles", "patches", "tiles", "most tiles", "their MiB", "selection, ms", "frame, ms", "promised, px", "observed, px"], lines))
    for what, title, unit in (("triangles", "Triangles", ""), ("select_ms", "Time of selection", "ms"), ("observed_px", "Largest observed error", "px")):
        picture = f"docs/experiments-{name}-{what}.svg"
        chart(os.path.join(ROOT, picture), f"{title} along the path, patch 32, {name}", {k: [r[what] for r in rows] for k, rows in by_patch[32].items()}, unit)
        out.append(f"![{title} along the camera path by tile size]({picture})\n")


def ratios(lab, name, dems, out):
    """Edge rules, and the hybrid against tiles alone."""
    file = lab.file(name, dems, 256, 64)
    small = lab.file(name, dems, 64, 16)
    lines = []
    for tolerance in ("0.7", "1", "2", "4"):
        for label, options in (("shared", []), ("paper", ["--edge-rule", "paper"])):
            rows = lab.path(file, f"{label}-{tolerance}", "--tolerance", tolerance, *options)
            lines.append([f"{tolerance} px, {label}", number(mean(rows, "triangles"), "{:,.0f}"), number(mean(rows, "tiles"), "{:.0f}"),
                          number(median(rows, "frame_ms"), "{:.0f}"), number(most(rows, "observed_px"), "{:.3f}"),
                          number(sum(v > float(tolerance) for v in column(rows, "observed_px")), "{:.0f}")])
    out.append("### Edge rules\n\nTile 256, patch 64. The last column counts frames whose observed error is above the tolerance.\n")
    out.append(table(["tolerance, rule", "triangles", "tiles", "frame, ms", "observed, px", "frames above"], lines))
    lines = []
    for tile, patch, path in ((256, 64, file), (64, 16, small)):
        hybrid = lab.path(path, "hybrid", "--tolerance", "1", observe=False)
        chunks = lab.path(path, "tiles", "--tolerance", "1", "--lod", "tiles", observe=False)
        compared = [("hybrid", hybrid), ("tiles only", chunks)]
        if name == "real":
            compared.append(("full resolution", lab.path(path, "full", "--lod", "full", observe=False)))
        for label, rows in compared:
            lines.append([f"{tile} / {patch}, {label}", number(mean(rows, "triangles"), "{:,.0f}"), number(median(rows, "frame_ms"), "{:.0f}"),
                          number(mean(rows, "triangles") / mean(hybrid, "triangles")), number(median(rows, "frame_ms") / median(hybrid, "frame_ms"))])
    out.append("### Hybrid against tile-only level of detail\n\nAt 1 pixel. *Tiles only* draws every patch of the selected tiles at full resolution, as chunked LOD does; "
               "*full resolution* draws the leaves (of the real terrain: those of the other are too many).\n")
    out.append(table(["tile / patch", "triangles", "frame, ms", "triangles : hybrid", "time : hybrid"], lines))


def machine(lab):
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        name = next((line.split(":")[1].strip() for line in file if line.startswith("model name")), platform.processor())
    return f"{name}, {os.cpu_count()} processors; {platform.system()} {platform.release()}; adapter `{lab.args.adapter}`"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", default=os.path.join(ROOT, "target", "experiments-data"))
    parser.add_argument("--mosaic", nargs="+", default=[os.path.join(ROOT, "fixtures", "dem", "co_elevation_float32_lzw.tif")])
    parser.add_argument("--side", type=int, default=16385)
    parser.add_argument("--frames", type=int, default=16)
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--adapter", default="software")
    parser.add_argument("--report-only", action="store_true")
    args = parser.parse_args()
    lab = Lab(args)
    if not args.report_only:
        lab.build()
    terrains = [
        ("real", args.mosaic, "Real terrain: " + ", ".join(f"`{os.path.basename(dem)}`" for dem in args.mosaic)),
        ("synthetic", [lab.synthetic(args.side)], f"Synthetic terrain, {args.side} x {args.side} (`examples/synth`)"),
    ]
    out = ["# Experiments\n",
           "Written by `bench/experiments.py`; do not edit. The experiments of papers 000 and 001, repeated along one camera path for each terrain, "
           f"{args.frames} frames of {args.size}, everything loaded before a frame is drawn.\n",
           f"- Machine: {machine(lab)}",
           "- Drawn in software: read ratios, not frame rates. *Frame* is the time from the first command to the finished picture; the median over the path, as that of selection; other columns are means unless they say most.",
           "- *Observed* is exact: over every sample of the raster in view, the largest distance in pixels between its true place and the surface drawn "
           "(`relevo::observed`). *Promised* is what the tables in the file say it is at most.\n"]
    for name, dems, about in terrains:
        out.append(f"## {about}\n\n### Tile and patch sizes\n\nTolerance 1 pixel.\n")
        sizes(lab, name, dems, out)
        ratios(lab, name, dems, out)
    out.append("## How to repeat\n\n```sh\nbench/experiments.py --mosaic DEM... --side " + f"{args.side} --frames {args.frames} --size {args.size}\n```\n")
    with open(os.path.join(ROOT, "EXPERIMENTS.md"), "w", encoding="utf-8") as file:
        file.write("\n".join(out))
    say("written: EXPERIMENTS.md")


if __name__ == "__main__":
    main()
