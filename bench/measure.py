"""Runs the programs on one raster, in turn, and writes what they took to DATA/results/CASE.json.

    measure.py DATA CASE RUNS PROGRAMS

Runs that are in the file already are not repeated, unless relevo has changed since.
"""

import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import time

COG = ["COMPRESS=ZSTD", "PREDICTOR=YES", "NUM_THREADS=2", "OVERVIEW_RESAMPLING=NEAREST", "BIGTIFF=IF_SAFER"]
TIME = {
    "user": r"User time \(seconds\): ([\d.]+)",
    "sys": r"System time \(seconds\): ([\d.]+)",
    "rss_kib": r"Maximum resident set size \(kbytes\): (\d+)",
}


def output_of(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def sha256(path):
    with open(path, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()


def save(path, value):
    with open(path + ".new", "w", encoding="utf-8") as file:
        json.dump(value, file, indent=1)
    os.replace(path + ".new", path)


def machine(programs):
    """What the figures depend on."""
    def grep(path, pattern):
        try:
            with open(path, encoding="utf-8") as file:
                found = re.search(pattern, file.read(), re.M)
        except OSError:
            found = None
        return found[1] if found else "unknown"

    return {
        "cpu": grep("/proc/cpuinfo", r"^model name\s*: (.*)$"),
        "cores": os.cpu_count(),
        "ram_gib": round(int(grep("/proc/meminfo", r"^MemTotal:\s*(\d+)")) / 2**20, 1),
        "os": grep("/etc/os-release", r'^PRETTY_NAME="(.*)"$'),
        "kernel": platform.release(),
        "relevo": output_of(os.path.join(programs, "relevo"), "--version"),
        "rustc": output_of("rustc", "--version"),
        "gdal": output_of("gdalinfo", "--version").split(",")[0],
        "hyperfine": output_of("hyperfine", "--version") if shutil.which("hyperfine") else None,
        "date": time.strftime("%Y-%m-%d"),
    }


def timed(command, work):
    """Wall time, processor time and memory of one run; what it printed."""
    report, times = os.path.join(work, "time.txt"), os.path.join(work, "times.json")
    command = ["/usr/bin/time", "-v", "-o", report, *command]
    log = os.path.join(work, "log.txt")
    with open(log, "w", encoding="utf-8") as file:
        start = time.monotonic()
        if shutil.which("hyperfine"):
            line = " ".join("'" + word.replace("'", "'\\''") + "'" for word in command)
            options = ["-N", "--style", "none", "--warmup", "0", "--runs", "1", "--output", log + ".out"]
            whole = ["hyperfine", *options, "--export-json", times, line]
            done = subprocess.run(whole, stdout=file, stderr=file, check=False)
        else:
            with open(log + ".out", "w", encoding="utf-8") as out:
                done = subprocess.run(command, stdout=out, stderr=file, check=False)
        wall = time.monotonic() - start
    if done.returncode != 0:
        with open(log, encoding="utf-8") as file:
            sys.exit(f"measure.py: {' '.join(command)} failed:\n{file.read()}")
    if shutil.which("hyperfine"):
        with open(times, encoding="utf-8") as file:
            wall = json.load(file)["results"][0]["median"]
    with open(report, encoding="utf-8") as file:
        text = file.read()
    run = {"wall": wall, **{key: float(re.search(pattern, text)[1]) for key, pattern in TIME.items()}}
    with open(log + ".out", encoding="utf-8") as file:
        return run, file.read()


def commands(dem, work, programs):
    """Every command by name, and what it writes."""
    rlv, tif = os.path.join(work, "out.rlv"), os.path.join(work, "out.tif")
    build = [os.path.join(programs, "relevo"), "build", dem, "-o", rlv, "--progress", "none"]
    decode = [os.path.join(programs, "examples", "decode_only"), dem]
    cog = [word for option in COG for word in ("-co", option)]
    return {
        "gdal": (["gdal_translate", "-q", "-of", "COG", *cog, dem, tif], tif),
        "gdal-fast": (["gdal_translate", "-q", "-of", "COG", *cog, "-co", "LEVEL=1", dem, tif], tif),
        "decode-1": ([*decode, "1"], None),
        "decode-2": ([*decode, "2"], None),
        "relevo-1": ([*build, "--jobs", "1"], rlv),
        "relevo-2": ([*build, "--jobs", "2"], rlv),
    }


def read_through(path):
    """Brings a file into the page cache as far as it fits."""
    with open(path, "rb", buffering=0) as file:
        while file.read(1 << 24):
            pass


def main():
    data, case, runs, programs = sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4]
    dem = os.path.join(data, case + ".tif")
    work = os.path.join(data, "scratch")
    # What an interrupted run left there would stand in the way.
    shutil.rmtree(work, ignore_errors=True)
    os.makedirs(work)
    save(os.path.join(data, "results", "machine.json"), machine(programs))
    path = os.path.join(data, "results", case + ".json")
    stamp = sha256(os.path.join(programs, "relevo"))
    result = {}
    if os.path.exists(path):
        with open(path, encoding="utf-8") as file:
            result = json.load(file)
        if result["relevo_sha256"] != stamp:
            print(f"{case}: relevo is another one, measured again", file=sys.stderr)
            result = {}
    width, height = json.loads(output_of("gdalinfo", "-json", dem))["size"]
    todo = commands(dem, work, programs)
    if not result:
        result = {"case": case, "relevo_sha256": stamp, "runs": {name: [] for name in todo}, "reader": None}
        result |= {"width": width, "height": height, "source_bytes": os.path.getsize(dem)}
        hide = lambda word: word.replace(data, "$DATA").replace(programs + "/examples/", "").replace(programs + "/", "")
        result["commands"] = {name: " ".join(map(hide, command)) for name, (command, _) in todo.items()}
    if width * height > 2**31:
        runs = 1
    for turn in range(runs):
        for name, (command, writes) in todo.items():
            done = result["runs"][name]
            if len(done) > turn:
                continue
            read_through(dem)
            # Every program makes a new file.
            if writes and os.path.exists(writes):
                os.remove(writes)
            run, _ = timed(command, work)
            if writes:
                run["bytes"] = os.path.getsize(writes)
            done.append(run)
            save(path, result)
            print(f"{case} {name} {turn + 1}/{runs}: {run['wall']:.2f} s, {run['rss_kib'] / 1024:.0f} MiB", file=sys.stderr)
            if name.startswith("gdal"):
                os.remove(writes)
    if result["reader"] is None:
        rlv = os.path.join(work, "out.rlv")
        if not os.path.exists(rlv):
            timed(todo["relevo-2"][0], work)
        read_through(rlv)
        text = output_of(os.path.join(programs, "examples", "read_bench"), rlv, "1", "2")
        result["reader"] = json.loads(text)
        save(path, result)
    shutil.rmtree(work)


main()
