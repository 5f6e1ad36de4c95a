#!/usr/bin/env python3
"""Holds what Relevo takes a raster for against what GDAL takes it for.

    differential.py --relevo target/debug/relevo [--count 400] [--seed 1] [--keep FOLDER] [--only N] [--gdal]

Writes rasters with GDAL's Python bindings, each a choice of one value for every feature in FEATURES: sample type,
layout, place, coordinate system, nodata, mask, unit, scale, and the file that says so (tags, .aux.xml, world file).
The choices are seeded; the first ones are made so that every pair of values of two features occurs. Each raster goes
through `relevo build` and `relevo export`, and place, coordinate system (IsSame), validity, samples, scale, offset and
unit of the export, and what `relevo info --json` says, are compared with GDAL's reading of the input. What the
generator meant does not count.

A raster that Relevo refuses is a failure unless the refusal is one of REFUSALS, or, without --gdal, which says that
GDAL is built in, one of REFUSALS_WITHOUT_GDAL. Prints one line for every difference,
then a summary; exits with 1 if there was a difference or if a pair of values never occurred.
"""

import argparse
import gzip
import itertools
import json
import math
import multiprocessing
import os
import random
import shutil
import subprocess
import sys
import tempfile
from xml.sax.saxutils import escape

import numpy as np
from osgeo import gdal, osr

gdal.UseExceptions()
osr.UseExceptions()

MOLLWEIDE = "+proj=moll +lon_0=0 +datum=WGS84 +units=m"
OWN_TMERC = "+proj=tmerc +lat_0=0 +lon_0=9 +k=0.9997 +x_0=1000000 +y_0=0 +ellps=bessel +units=m"
OWN_FEET = "+proj=lcc +lat_1=33 +lat_2=45 +lat_0=39 +lon_0=-96 +datum=NAD83 +units=us-ft"
SPHERE = "+proj=longlat +a=3396190 +b=3396190"

FEATURES = {
    "type": ["Byte", "UInt16", "Int16", "UInt32", "Int32", "Float32", "Float64"],
    "layout": ["strip", "strip1", "tile"],
    "compress": ["NONE", "LZW", "DEFLATE", "ZSTD", "PREDICTOR"],
    "endian": ["LITTLE", "BIG"],
    "bigtiff": ["NO", "YES"],
    "container": ["plain", "vrt", "gz"],
    "place": ["none", "north", "south", "shear", "point", "unequal"],
    "place_in": ["tags", "aux", "tfw", "wld", "TFW", "tags+aux", "tags+tfw"],
    "crs": ["none", "EPSG:4326", "EPSG:32611", "EPSG:2263", "EPSG:27700", "EPSG:3857", "EPSG:3031", "EPSG:4267",
            "EPSG:4326+5773", "EPSG:26910+5703", "EPSG:25832", "EPSG:21781", "ESRI:102100", "ESRI:54009",
            "moll", "tmerc", "feet", "sphere", "local"],
    "crs_in": ["tags", "aux", "prj", "tags+aux"],
    "nodata": ["none", "low", "text", "fraction", "nan", "outside", "zero", "high"],
    "nodata_in": ["tags", "aux", "tags+aux"],
    "mask": ["none", "internal", "external", "alpha", "alpha16"],
    "unit": ["none", "m", "ft", "US survey foot", "odd"],
    "scale": ["none", "both", "offset", "negative"],
    "words_in": ["tags", "aux", "tags+aux"],
    "band": [1, 2, 3],
}

# What a build without GDAL may refuse, by name: a feature, its values, and words of the message.
REFUSALS_WITHOUT_GDAL = [
    ("container", ["vrt"], "a VRT with a mask of its own"),
    ("container", ["vrt"], "a VRT with an alpha band"),
]
# What every build may refuse.
REFUSALS = [
    # Numbers near a nodata value at the end of a float's range, that do not count as it to GDAL, times a scale.
    ("nodata", ["low", "high", "text", "outside"], "heights: expected finite metres"),
]

NUMPY = {"Byte": np.uint8, "UInt16": np.uint16, "Int16": np.int16, "UInt32": np.uint32, "Int32": np.int32,
         "Float32": np.float32, "Float64": np.float64}
METRES = {"": 1.0, "m": 1.0, "metre": 1.0, "meter": 1.0, "ft": 0.3048, "foot": 0.3048,
          "US survey foot": 1200 / 3937, "ftUS": 1200 / 3937}


PLACES = {name: place for place, name in enumerate(FEATURES)}


def pairs_of(case):
    """All pairs (feature, value, feature, value) of a case."""
    return {(a, case[a], b, case[b]) for a, b in itertools.combinations(FEATURES, 2)}


def cases(count, seed):
    """`count` cases: first those that cover all pairs that are possible, then random ones."""
    rng = random.Random(seed)
    missing = {(a, x, b, y) for a, b in itertools.combinations(FEATURES, 2) for x in FEATURES[a] for y in FEATURES[b]}
    missing = {pair for pair in missing if possible(dict([pair[:2], pair[2:]]))}
    order = sorted(missing, key=repr)
    rng.shuffle(order)
    made = []
    while len(made) < count:
        while order and order[-1] not in missing:
            order.pop()
        pinned = dict([order[-1][:2], order[-1][2:]]) if order else {}
        case = completed(pinned, missing, rng)
        if case:
            missing -= pairs_of(case)
            made.append(case)
    return made, missing


def completed(pinned, missing, rng):
    """A case with the values `pinned`, the others chosen one by one: whichever has the most missing pairs so far."""
    case = dict(pinned)
    for name in rng.sample([name for name in FEATURES if name not in case], len(FEATURES) - len(case)):
        values = [value for value in FEATURES[name] if possible({**case, name: value})]
        if not values:
            return None
        gains = [sum(pair(name, value, *item) in missing for item in case.items()) for value in values]
        best = [value for value, gain in zip(values, gains) if gain == max(gains)]
        case[name] = rng.choice(best)
    return case


def pair(a, x, b, y):
    """A pair of values, its features in their order."""
    return (a, x, b, y) if PLACES[a] < PLACES[b] else (b, y, a, x)


def possible(case):
    """False if two values exclude one another: the file would not hold one of them."""
    get = case.get
    beside = [get("place_in", "tags"), get("crs_in", "tags"), get("nodata_in", "tags"), get("words_in", "tags")]
    if get("container") == "gz" and (any(where != "tags" for where in beside) or get("mask") == "external"):
        return False
    if get("place") == "none" and get("place_in", "tags") != "tags":
        return False
    if get("place") == "point" and get("place_in", "tags") not in ("tags", "tags+aux", "tags+tfw"):
        return False
    if get("crs") == "none" and get("crs_in", "tags") != "tags":
        return False
    # A local system has no text that a .prj can hold.
    if get("crs") == "local" and get("crs_in") == "prj":
        return False
    # A .prj is read only beside a place of its own.
    if get("nodata") == "none" and get("nodata_in", "tags") != "tags":
        return False
    if get("unit") == "none" and get("scale") == "none" and get("words_in", "tags") != "tags":
        return False
    if get("nodata") in ("nan", "text") and get("type", "Float32") not in ("Float32", "Float64"):
        return False
    if get("mask") == "alpha16" and (get("type", "UInt16") != "UInt16" or get("nodata") in ("nan", "text")):
        return False
    if get("compress") == "PREDICTOR" and get("type") == "Float64" and get("endian") == "BIG":
        return False
    return True


def system(name):
    """A coordinate system of FEATURES, or None."""
    own = {"moll": MOLLWEIDE, "tmerc": OWN_TMERC, "feet": OWN_FEET, "sphere": SPHERE}
    if name == "none":
        return None
    spatial = osr.SpatialReference()
    spatial.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
    if name == "local":
        spatial.SetFromUserInput('LOCAL_CS["mine",UNIT["metre",1]]')
    else:
        spatial.SetFromUserInput(own.get(name, name))
    return spatial


def geotransform(case):
    """GDAL's geotransform of a case, in numbers that suit its coordinate system."""
    spatial = system(case["crs"])
    degrees = spatial is not None and spatial.IsGeographic()
    x, y, size = (10.5, 45.25, 0.01) if degrees else (500123.5, 4100456.25, 30.0)
    return {
        "none": None,
        "north": (x, size, 0.0, y, 0.0, -size),
        "point": (x, size, 0.0, y, 0.0, -size),
        "south": (x, size, 0.0, y, 0.0, size),
        "shear": (x, size, size / 8, y, -size / 4, -size),
        "unequal": (x, size, 0.0, y, 0.0, -size / 3),
    }[case["place"]]


def nodata_value(case, rng):
    """A nodata value (a text where its digits matter) and the numbers near it that samples get."""
    kind = NUMPY[case["type"]]
    floating = np.issubdtype(kind, np.floating)
    info = np.finfo(kind) if floating else np.iinfo(kind)
    text = {
        "none": None,
        "low": repr(float(info.min)) if floating else str(info.min),
        "high": repr(float(info.max)) if floating else str(info.max),
        "zero": "0",
        "nan": "nan",
        "fraction": "17.4" if info.min == 0 else "-9999.4",
        "outside": "-99999" if not floating and info.bits < 32 else "-1e300",
        "text": rng.choice(["-3.4e+38", "-3.40282e+38", "-3.4028235e+38", "-3.402823466e+38", "-3.40282346600000016e+38",
                            "3.4028234663852886e+38", "1.17549435e-38", "-1.175494351e-38", "0.1", "-9999.1", "1e20"]),
    }[case["nodata"]]
    if text is None:
        return None, []
    value = float(text)
    if not floating:
        near = [round(value) + step for step in (-1, 0, 1)] + [int(value)]
        return text, [x for x in near if info.min <= x <= info.max]
    with np.errstate(over="ignore"):
        centre = kind(value)
    near = [centre]
    for direction in (-np.inf, np.inf):
        step = centre
        for _ in range(4):
            with np.errstate(over="ignore"):
                step = np.nextafter(step, kind(direction))
            near.append(step)
    return text, near


def samples(case, width, height, rng):
    """Heights of a band, some of them equal to the nodata value or next to it."""
    kind = NUMPY[case["type"]]
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    heights = 100 + 60 * np.sin(x / 5 + rng.random()) * np.cos(y / 4) + np.random.RandomState(rng.randrange(2**31)).rand(
        height, width)
    array = heights.astype(kind)
    text, near = nodata_value(case, rng)
    for value in near:
        for _ in range(3):
            array[rng.randrange(height), rng.randrange(width)] = value
    if text is not None and np.issubdtype(kind, np.floating):
        array[rng.randrange(height), rng.randrange(width)] = np.nan
    return array, text


def write(case, folder, seed):
    """Writes the raster of a case; gives the file for Relevo and the name for GDAL."""
    rng = random.Random(seed)
    width, height = rng.choice([(37, 29), (16, 40), (65, 33), (5, 5)])
    path = os.path.join(folder, "dem.tif")
    alpha = case["mask"] in ("alpha", "alpha16")
    bands = case["band"] + (1 if alpha else 0)
    options = ["BIGTIFF=" + case["bigtiff"], "ENDIANNESS=" + case["endian"], "PHOTOMETRIC=MINISBLACK"]
    options.append("ALPHA=YES" if alpha else "ALPHA=NO")
    if case["layout"] == "tile":
        options += ["TILED=YES", "BLOCKXSIZE=16", "BLOCKYSIZE=16"]
    elif case["layout"] == "strip1":
        options += ["BLOCKYSIZE=1"]
    if case["compress"] == "PREDICTOR":
        options += ["COMPRESS=DEFLATE", "PREDICTOR=" + ("3" if case["type"].startswith("Float") else "2")]
    else:
        options += ["COMPRESS=" + case["compress"]]
    options += ["INTERLEAVE=" + rng.choice(["BAND", "PIXEL"])]
    spatial, transform = system(case["crs"]), geotransform(case)
    tagged = {name: "tags" in case[name] for name in ("place_in", "crs_in", "nodata_in", "words_in")}
    gdal.SetConfigOption("GDAL_PAM_ENABLED", "NO")
    gdal.SetConfigOption("GDAL_TIFF_INTERNAL_MASK", "YES" if case["mask"] == "internal" else "NO")
    if case["place"] == "point":
        gdal.SetConfigOption("GTIFF_POINT_GEO_IGNORE", None)
    dataset = gdal.GetDriverByName("GTiff").Create(path, width, height, bands, gdal.GetDataTypeByName(case["type"]),
                                                   options)
    text = None
    if case["place"] == "point":
        dataset.SetMetadataItem("AREA_OR_POINT", "Point")
    if transform and tagged["place_in"]:
        dataset.SetGeoTransform(transform)
    if spatial and tagged["crs_in"]:
        dataset.SetSpatialRef(spatial)
    for index in range(1, bands + 1):
        band = dataset.GetRasterBand(index)
        array, text = samples(case, width, height, rng)
        if alpha and index == bands:
            high = 65535 if case["mask"] == "alpha16" else 255
            array = np.array(rng.choices([0, 1, high // 2, high], k=width * height)).reshape(height, width)
            array = np.minimum(array, np.iinfo(NUMPY[case["type"]]).max) if case["type"] in ("Byte",) else array
            band.WriteArray(array.astype(NUMPY[case["type"]]))
            continue
        if text is not None and tagged["nodata_in"]:
            band.SetNoDataValue(float(text))
        if tagged["words_in"]:
            say_words(case, band)
        band.WriteArray(array)
    if case["mask"] in ("internal", "external"):
        dataset.CreateMaskBand(gdal.GMF_PER_DATASET)
        mask = np.array(rng.choices([0, 255], k=width * height)).reshape(height, width).astype(np.uint8)
        dataset.GetRasterBand(1).GetMaskBand().WriteArray(mask)
    dataset = None
    if text is not None and tagged["nodata_in"] and case["nodata"] == "text":
        retype_nodata(path, text)
    write_sidecars(case, folder, path, spatial, transform, text)
    gdal.SetConfigOption("GDAL_PAM_ENABLED", None)
    if case["container"] == "gz":
        with open(path, "rb") as plain, gzip.open(path + ".gz", "wb", compresslevel=1) as packed:
            shutil.copyfileobj(plain, packed)
        os.remove(path)
        return path + ".gz", "/vsigzip/" + path + ".gz"
    if case["container"] == "vrt":
        made = os.path.join(folder, "dem.vrt")
        gdal.Translate(made, path, format="VRT")
        return made, made
    return path, path


def retype_nodata(path, text):
    """Puts a text of the same length or shorter where GDAL wrote its own digits of the nodata value."""
    with open(path, "r+b") as file:
        content = file.read()
        written = ("%.17g" % float(text)).encode()
        for candidate in (written, ("%.18g" % float(text)).encode()):
            at = content.find(candidate + b"\0")
            if at >= 0 and len(text) <= len(candidate):
                file.seek(at)
                file.write(text.encode().ljust(len(candidate), b"\0"))
                return


def say_words(case, band):
    """Unit, scale and offset of a band."""
    if case["unit"] != "none":
        band.SetUnitType("fathom of " + "x" if case["unit"] == "odd" else case["unit"])
    if case["scale"] in ("both", "negative"):
        band.SetScale(0.25 if case["scale"] == "both" else -0.5)
    if case["scale"] in ("both", "offset"):
        band.SetOffset(-100.5)


def write_sidecars(case, folder, path, spatial, transform, text):
    """What stands beside the file. Where the tags speak as well, it says something else, so that precedence shows."""
    aux = []
    if spatial and "aux" in case["crs_in"]:
        shown = system("EPSG:3395") if case["crs_in"] == "tags+aux" else spatial
        axes = ",".join(map(str, shown.GetDataAxisToSRSAxisMapping()))
        aux.append('<SRS dataAxisToSRSAxisMapping="%s">%s</SRS>' % (axes, escape(shown.ExportToWkt())))
    if transform and "aux" in case["place_in"]:
        shift = 7.0 if case["place_in"] == "tags+aux" else 0.0
        numbers = ", ".join("%.16e" % (value + (shift if at in (0, 3) else 0)) for at, value in enumerate(transform))
        aux.append("<GeoTransform>%s</GeoTransform>" % numbers)
    for index in range(1, case["band"] + 1):
        items = []
        if text is not None and "aux" in case["nodata_in"]:
            items.append("<NoDataValue>%s</NoDataValue>" % (text if case["nodata_in"] == "aux" else "42"))
        if "aux" in case["words_in"]:
            other = case["words_in"] == "tags+aux"
            if case["unit"] != "none":
                unit = "fathom of x" if case["unit"] == "odd" else case["unit"]
                items.append("<UnitType>%s</UnitType>" % ("ft" if other else escape(unit)))
            if case["scale"] in ("both", "offset"):
                items.append("<Offset>%s</Offset>" % (7 if other else -100.5))
            if case["scale"] in ("both", "negative"):
                items.append("<Scale>%s</Scale>" % (3 if other else 0.25 if case["scale"] == "both" else -0.5))
        if items:
            aux.append('<PAMRasterBand band="%d">%s</PAMRasterBand>' % (index, "".join(items)))
    if aux:
        with open(path + ".aux.xml", "w") as file:
            file.write("<PAMDataset>\n  %s\n</PAMDataset>\n" % "\n  ".join(aux))
    for suffix in ("tfw", "wld", "TFW"):
        if transform and case["place_in"].endswith(suffix):
            x0, a, b, y0, d, e = transform
            if case["place_in"].startswith("tags"):
                x0 += 1000.0
            lines = [a, d, b, e, x0 + a / 2 + b / 2, y0 + d / 2 + e / 2]
            with open(os.path.join(folder, "dem." + suffix), "w") as file:
                file.write("".join("%.16g\n" % line for line in lines))
    if spatial and case["crs_in"] == "prj":
        shown = spatial.Clone()
        shown.MorphToESRI()
        with open(os.path.join(folder, "dem.prj"), "w") as file:
            file.write(shown.ExportToWkt() + "\n")


def beside(given):
    """The system of the .prj beside a raster with a place, which GDAL's TIFF driver does not look for, as GDAL reads its
    text; without its vertical part, which has no code there."""
    path = os.path.join(os.path.dirname(given.GetDescription()), "dem.prj")
    if given.GetGeoTransform(can_return_null=True) is None or not os.path.exists(path):
        return None
    spatial = osr.SpatialReference()
    with open(path) as file:
        spatial.ImportFromESRI(file.read().splitlines())
    spatial.StripVertical()
    spatial.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
    return spatial


def metres_of(band, spatial):
    """Metres of one unit of height as GDAL tells it: the band's unit, else that of the vertical system; None: unknown."""
    unit = band.GetUnitType()
    if unit:
        return METRES.get(unit)
    if spatial is not None and spatial.IsCompound():
        return spatial.GetTargetLinearUnits("VERT_CS")
    return 1.0


def same_system(one, other):
    """None if two coordinate systems are the same, whatever the order of their axes, else how they differ."""
    if one is None or other is None:
        return None if one is other else "%s is not %s" % (name_of(one), name_of(other))
    ways = ["IGNORE_DATA_AXIS_TO_SRS_AXIS_MAPPING=YES", "CRITERION=EQUIVALENT_EXCEPT_AXIS_ORDER_GEOGCRS"]
    if one.IsSame(other, ways):
        return None
    # Text of ESRI's and GeoTIFF keys have no words for the directions of axes at a pole.
    if one.IsProjected() and other.IsProjected() and one.IsSameGeogCS(other):
        if one.ExportToProj4() == other.ExportToProj4() and not one.IsCompound() and not other.IsCompound():
            return None
    return "%s is not %s" % (name_of(one), name_of(other))


def name_of(spatial):
    """For messages: the name, and the projection where PROJ has words for it."""
    if spatial is None:
        return "no system"
    try:
        return "%s (%s)" % (spatial.GetName(), spatial.ExportToProj4())
    except RuntimeError:
        return spatial.GetName()


def compare(given, band_number, made, info):
    """Differences between GDAL's reading of the input and of what Relevo made of it."""
    found = []
    band, out = given.GetRasterBand(band_number), made.GetRasterBand(1)
    place, again = given.GetGeoTransform(can_return_null=True), made.GetGeoTransform(can_return_null=True)
    plain = (0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    scale = max(map(abs, place or plain))
    if any(abs(a - b) > 1e-12 * scale for a, b in zip(place or plain, again or plain)):
        found.append("place: GDAL %s, export %s" % (place, again))
    spatial = given.GetSpatialRef()
    # A tag that says "points" is a system without a name to GDAL; a VRT that has one says so itself.
    unnamed = spatial is not None and spatial.IsLocal() and spatial.GetName() == "unnamed"
    if spatial is None or (unnamed and given.GetDriver().ShortName != "VRT"):
        spatial = beside(given) or spatial
    different = same_system(spatial, made.GetSpatialRef())
    if different:
        found.append("system: " + different)
    found += compare_info(given, spatial, info)
    valid, valid_out = validity(band), validity(out)
    if not np.array_equal(valid, valid_out):
        wrong = np.argwhere(valid != valid_out)[0]
        value = band.ReadAsArray()[tuple(wrong)]
        found.append("validity: %d samples differ; first at row %d column %d, %r, GDAL %s, nodata %r, flags %d" % (
            int((valid != valid_out).sum()), wrong[0], wrong[1], value, bool(valid[tuple(wrong)]),
            band.GetNoDataValue(), band.GetMaskFlags()))
    else:
        one, other = band.ReadAsArray()[valid], out.ReadAsArray()[valid]
        if one.dtype != other.dtype or not np.array_equal(one, other):
            found.append("samples differ (%s, %s)" % (one.dtype, other.dtype))
    for word, a, b in (("scale", band.GetScale(), out.GetScale()), ("offset", band.GetOffset(), out.GetOffset())):
        neutral = 1.0 if word == "scale" else 0.0
        a, b = neutral if a is None else a, neutral if b is None else b
        if a != b:
            found.append("%s: GDAL %r, export %r" % (word, a, b))
    metres = metres_of(band, spatial)
    if metres is not None:
        for where, got in (("export", metres_of(out, made.GetSpatialRef())), ("info", info["unit_metres"])):
            if got is None or not math.isclose(metres, got, rel_tol=1e-9):
                found.append("unit: GDAL %r (%r m), %s %r m" % (band.GetUnitType(), metres, where, got))
    return found


def compare_info(given, spatial, info):
    """What `relevo info --json` says of the coordinate system."""
    found = []
    crs = info["metadata"]["crs"]
    kind = "engineering"
    if spatial is not None:
        kind = "geographic" if spatial.IsGeographic() else "projected" if spatial.IsProjected() else kind
    if crs["kind"] != kind:
        found.append("kind: GDAL %s, info %s" % (kind, crs["kind"]))
    if kind == "engineering":
        return found
    unit = spatial.GetAngularUnits() if kind == "geographic" else spatial.GetLinearUnits()
    if not math.isclose(unit, crs["unit"], rel_tol=1e-8):
        found.append("horizontal unit: GDAL %r, info %r" % (unit, crs["unit"]))
    major, flat = spatial.GetSemiMajor(), spatial.GetInvFlattening()
    ellipsoid = crs["ellipsoid"]
    if abs(ellipsoid["a"] - major) > 1e-3 or abs(ellipsoid["inverse_flattening"] - flat) > 1e-6:
        found.append("ellipsoid: GDAL %r %r, info %r" % (major, flat, ellipsoid))
    if crs["epsg"] is not None:
        known = osr.SpatialReference()
        known.ImportFromEPSG(crs["epsg"])
        horizontal = spatial.Clone()
        horizontal.StripVertical()
        if same_system(known, horizontal):
            found.append("code: GDAL %s, info EPSG:%s" % (name_of(spatial), crs["epsg"]))
    return found


def validity(band):
    """Where a band has a height: by GDAL's mask, and never where it is not a number or infinite. An alpha band of any type is a
    mask, to GDAL one of bytes or 16 bits beside one or three bands only. A nodata value of a sidecar or a VRT that is
    the largest float32 with its last digit rounded up counts as that, as GDAL has it in tags."""
    array = band.ReadAsArray()
    valid = band.GetMaskBand().ReadAsArray() != 0
    dataset = band.GetDataset()
    last = dataset.GetRasterBand(dataset.RasterCount)
    if band.GetMaskFlags() == gdal.GMF_ALL_VALID:
        if rounds_to_float32(array.dtype, band.GetNoDataValue()):
            valid = mask_of(array, float(np.float32(band.GetNoDataValue())))
        elif last.GetColorInterpretation() == gdal.GCI_AlphaBand:
            valid = last.ReadAsArray() != 0
    return valid & np.isfinite(array) if np.issubdtype(array.dtype, np.floating) else valid


def rounds_to_float32(dtype, nodata):
    """True if a nodata value is beyond float32, and the next float32 is not."""
    if dtype != np.float32 or nodata is None or not abs(nodata) > float(np.finfo(np.float32).max):
        return False
    with np.errstate(over="ignore"):
        return bool(np.isfinite(np.float32(nodata)))


def mask_of(array, nodata):
    """Where GDAL finds float32 samples valid beside a nodata value."""
    copy = gdal.GetDriverByName("MEM").Create("", array.shape[1], array.shape[0], 1, gdal.GDT_Float32)
    copy.GetRasterBand(1).WriteArray(array)
    copy.GetRasterBand(1).SetNoDataValue(nodata)
    return copy.GetRasterBand(1).GetMaskBand().ReadAsArray() != 0


def run(arguments):
    return subprocess.run(arguments, capture_output=True, text=True, errors="replace", timeout=120)


def check(job):
    """Writes and checks one case; gives (number, case, differences, refused or None)."""
    number, case, seed, relevo, keep, refusals = job
    folder = os.path.join(keep, str(number)) if keep else tempfile.mkdtemp(prefix="relevo-differential-")
    os.makedirs(folder, exist_ok=True)
    try:
        return check_in(folder, number, case, seed, relevo, refusals)
    except Exception as error:  # noqa: BLE001 (told as a difference, with its case)
        return number, case, ["the check itself failed: %s: %s" % (type(error).__name__, error)], None
    finally:
        if not keep:
            shutil.rmtree(folder, ignore_errors=True)


def check_in(folder, number, case, seed, relevo, refusals):
    path, name = write(case, folder, seed * 1_000_003 + number)
    container, made = os.path.join(folder, "out.rlv"), os.path.join(folder, "out.tif")
    given = gdal.Open(name)
    if not validity(given.GetRasterBand(case["band"])).any():
        return number, case, [], "nothing valid"
    build = [relevo, "build", path, "-o", container, "--force", "--tile", "16", "--patch", "8", "--progress", "none"]
    if case["band"] != 1:
        build += ["--band", str(case["band"])]
    done = run(build)
    if done.returncode != 0:
        words = done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "exit %d" % done.returncode
        allowed = any(case[feature] in values and text in words for feature, values, text in refusals)
        return number, case, [] if allowed else ["refused: " + words], words
    done = run([relevo, "export", container, "-o", made, "--force"])
    if done.returncode != 0:
        return number, case, ["export: " + done.stderr.strip()], None
    info = json.loads(run([relevo, "info", "--json", container]).stdout)[0]
    return number, case, compare(given, case["band"], gdal.Open(made), info), None


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--relevo", required=True, help="the program")
    parser.add_argument("--count", type=int, default=400, help="rasters to write")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", help="leave the files in this folder")
    parser.add_argument("--only", type=int, help="the case of this number alone")
    parser.add_argument("--gdal", action="store_true", help="the program was built with GDAL")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    refusals = REFUSALS + ([] if arguments.gdal else REFUSALS_WITHOUT_GDAL)
    made, missing = cases(arguments.count, arguments.seed)
    jobs = [(number, case, arguments.seed, arguments.relevo, arguments.keep, refusals) for number, case in enumerate(made)
            if arguments.only in (None, number)]
    gdal.PushErrorHandler("CPLQuietErrorHandler")
    different, refused = 0, 0
    with multiprocessing.Pool(arguments.jobs) as pool:
        for number, case, found, words in pool.imap(check, jobs, chunksize=4):
            refused += words is not None
            different += bool(found)
            if found:
                said = " ".join("%s=%s" % item for item in case.items())
                print("%d: %s\n    %s" % (number, said, "\n    ".join(found)))
    for pair in sorted(missing, key=repr):
        print("never occurred: %s=%s with %s=%s" % pair)
    print("%d rasters, %d refused or void, %d differ; %d pairs of values never occurred" % (
        len(jobs), refused, different, len(missing)))
    sys.exit(1 if different or missing else 0)


if __name__ == "__main__":
    main()
