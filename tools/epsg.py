#!/usr/bin/env python3
"""Writes core/src/crs/epsg/table.z: what the EPSG dataset says of coordinate systems, from PROJ's proj.db.

    tools/epsg.py /usr/share/proj/proj.db

The table is text, one row a line, fields apart by `|`, sections apart by an empty line, rows by code; the whole is
deflated (zlib, level 9). core/src/crs/epsg/table.rs says what the fields are. Lengths are in metres, angles in degrees.
Made from EPSG v10.076, as PROJ 9.1.1 has it; the terms of use of the dataset (IOGP) let others use its values.
"""

import pathlib
import sqlite3
import sys
import zlib

TABLE = pathlib.Path(__file__).parent.parent / "core/src/crs/epsg/table.z"


def number(value):
    """The shortest decimal that gives the same float64; whole numbers without a point."""
    return repr(float(value)).removesuffix(".0")


def sexagesimal(value):
    """Degrees of DDD.MMSSsss, unit 9110."""
    sign, value = (-1 if value < 0 else 1), f"{abs(value):.10f}"
    whole, fraction = value.split(".")
    seconds = float(fraction[2:4] + "." + fraction[4:])
    return sign * (int(whole) + int(fraction[:2]) / 60 + seconds / 3600)


def plain(name):
    """Letters and digits."""
    return "".join(letter for letter in name.lower() if letter.isalnum())


class Dataset:
    def __init__(self, path):
        self.db = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
        rows = self.rows("select code, type, conv_factor from unit_of_measure where auth_name = 'EPSG'")
        self.units = {int(code): (kind, factor) for code, kind, factor in rows}

    def rows(self, query):
        """Codes come as numbers from some tables and as text from others: here, as text."""
        rows = self.db.execute(query)
        columns = [column[0] for column in rows.description]
        code = [name.split(".")[-1].endswith("code") for name in columns]
        return [tuple(str(v) if c and v is not None else v for v, c in zip(row, code)) for row in rows]

    def value(self, value, unit):
        """In degrees, metres or unity."""
        if int(unit) == 9110:
            return sexagesimal(value)
        kind, factor = self.units[int(unit)]
        if kind == "angle":
            # Degrees as they are: no rounding on the way through radians.
            return value if int(unit) in (9102, 9122) else value * factor / self.units[9102][1]
        return value * factor

    def ellipsoids(self):
        for code, name, a, unit, flattening, b in self.rows(
            "select code, name, semi_major_axis, uom_code, inv_flattening, semi_minor_axis from ellipsoid"
            " where auth_name = 'EPSG' order by cast(code as int)"
        ):
            if flattening is None:
                flattening = 0 if b == a else a / (a - b)
            yield code, name, number(self.value(a, unit)), number(flattening)

    def meridians(self):
        for code, name, longitude, unit in self.rows(
            "select code, name, longitude, uom_code from prime_meridian where auth_name = 'EPSG'"
            " order by cast(code as int)"
        ):
            yield code, name, number(self.value(longitude, unit))

    def datums(self):
        # ESRI's names, without their D_, where they are others than EPSG's.
        esri = dict(self.rows("select code, alt_name from alias_name where table_name = 'geodetic_datum'"
                              " and source = 'ESRI' and auth_name = 'EPSG'"))
        accuracy = self.accuracies()
        for code, name, ellipsoid, meridian in self.rows(
            "select code, name, ellipsoid_code, prime_meridian_code from geodetic_datum where auth_name = 'EPSG'"
            " order by cast(code as int)"
        ):
            name = name.removesuffix(" ensemble")
            alias = esri.get(code, "").removeprefix("D_")
            alias = "" if plain(alias) == plain(name) else alias
            # Realisations of WGS 84 and of what it follows agree within two metres by the dataset's word on the ensemble.
            families = ("World Geodetic System 1984", "International Terrestrial Reference Frame")
            within = accuracy.get(code, "2" if name.startswith(families) else "")
            yield code, name, ellipsoid, "" if meridian == "8901" else meridian, within, alias

    def accuracies(self):
        """Metres within which datums are WGS 84: those that a transformation of nothing but zeros leads to it from."""
        shifts = ", ".join(f"coalesce(abs({axis}), 0)" for axis in ("tx", "ty", "tz", "rx", "ry", "rz", "scale_difference"))
        rows = self.rows(
            "select g.datum_code, h.accuracy from helmert_transformation h, geodetic_crs g where h.auth_name = 'EPSG'"
            " and g.auth_name = 'EPSG' and g.code = h.source_crs_code and h.target_crs_code in ('4326', '4978', '4979')"
            f" and h.deprecated = 0 and max({shifts}) = 0 and h.accuracy is not null order by h.accuracy desc"
        )
        return {code: number(accuracy) for code, accuracy in rows}

    def geographic(self):
        units = dict(
            self.rows("select coordinate_system_code, uom_code from axis where auth_name = 'EPSG'"
                      " and coordinate_system_order = 1")
        )
        for code, name, kind, system, datum in self.rows(
            "select code, name, type, coordinate_system_code, datum_code from geodetic_crs where auth_name = 'EPSG'"
            " and type like 'geographic%' order by cast(code as int)"
        ):
            unit = units[system]
            yield code, name, datum, "" if unit in ("9102", "9122") else unit, "3" if "3D" in kind else ""

    def vertical(self):
        for code, name, datum, unit, axis in self.rows(
            "select v.code, v.name, d.name, a.uom_code, a.orientation from vertical_crs v, vertical_datum d, axis a"
            " where v.auth_name = 'EPSG' and d.auth_name = 'EPSG' and d.code = v.datum_code and a.auth_name = 'EPSG'"
            " and a.coordinate_system_code = v.coordinate_system_code order by cast(v.code as int)"
        ):
            datum = "" if datum == name else datum
            yield code, name, datum, "" if unit == "9001" else unit, "down" if axis == "down" else ""

    def compound(self):
        return self.rows(
            "select code, horiz_crs_code, vertical_crs_code from compound_crs where auth_name = 'EPSG'"
            " order by cast(code as int)"
        )

    def systems(self):
        """Axes of Cartesian coordinate systems: abbreviation and direction of both, and the unit."""
        found = {}
        for code, order, abbreviation, direction, unit in self.rows(
            "select coordinate_system_code, coordinate_system_order, abbrev, orientation, uom_code from axis"
            " where auth_name = 'EPSG' and coordinate_system_code in"
            " (select coordinate_system_code from projected_crs where auth_name = 'EPSG') order by 1, 2"
        ):
            row = found.setdefault(code, [code, unit])
            row += [abbreviation.split("(")[0], direction] if order < 3 else []
        return sorted(found.values(), key=lambda row: int(row[0]))

    def conversions(self):
        parameters = ", ".join(f"param{i}_code, param{i}_value, param{i}_uom_code" for i in range(1, 8))
        for code, name, method, *rest in self.rows(
            f"select code, name, method_code, {parameters} from conversion_table where auth_name = 'EPSG'"
            " and method_auth_name = 'EPSG' order by cast(code as int)"
        ):
            each = [rest[i : i + 3] for i in range(0, len(rest), 3) if rest[i] is not None]
            # Conversions of heights, of units and of axes are no projections.
            if all(8801 <= int(key) <= 8840 or int(key) in (1036, 1038, 1039) for key, *_ in each) and each:
                yield code, name, method, [key for key, *_ in each], [
                    number(self.value(value, unit)) for _, value, unit in each
                ]

    def projected(self):
        return self.rows(
            "select code, name, geodetic_crs_code, conversion_code, coordinate_system_code from projected_crs"
            " where auth_name = 'EPSG' order by cast(code as int)"
        )


def main(path):
    data = Dataset(path)
    methods, conversions, names = {}, [], {}
    for code, name, method, keys, values in data.conversions():
        if methods.setdefault(method, keys) != keys:
            sys.exit(f"conversion {code}: parameters {keys}, others of method {method} have {methods[method]}")
        conversions.append((code, name, method, *values))
        names[code] = name
    geographic = list(data.geographic())
    bases = {row[0]: row[1] for row in geographic}
    projected = []
    for code, name, base, conversion, system in data.projected():
        if conversion not in names:
            print(f"EPSG:{code} {name}: left out, its projection has other parameters")
            continue
        head, tail = bases[base] + " / ", name
        if name.startswith(head):
            tail = "/" + name.removeprefix(head)
            tail = "" if tail == "/" + names[conversion] else tail
        projected.append((code, base, conversion, "" if system == "4400" else system, tail))
    sections = [
        data.ellipsoids(), data.meridians(), data.datums(), geographic, data.vertical(), data.systems(),
        [(method, *keys) for method, keys in sorted(methods.items())], conversions, projected,
        data.compound(),
    ]
    text = "\n\n".join("\n".join("|".join(row) for row in rows) for rows in sections) + "\n"
    TABLE.write_bytes(zlib.compress(text.encode(), 9))
    print(f"{TABLE.name}: {TABLE.stat().st_size} bytes of {len(text)}")
    return text


if __name__ == "__main__":
    main(*sys.argv[1:])
