//! Lies in the header, the metadata, the statistics and about imagery: what a file states in words
//! and numbers of its own.

use std::path::Path;

use serde_json::{Value, json};

use super::{report, words};
use crate::verify::lies::{Lie, With, tell, usual};
use crate::verify::patch::{METADATA, Parts, STATISTICS};

/// A member of a JSON value.
pub fn member<'a>(value: &'a mut Value, path: &str) -> &'a mut Value {
    value.pointer_mut(path).unwrap()
}

const IN_THE_HEADER: &[Lie] = &[
    ("width", With::Nothing, "statistics", |p| p.set(32, &99_u32.to_le_bytes())),
    ("height", With::Nothing, "statistics", |p| p.set(36, &81_u32.to_le_bytes())),
    ("tile size", With::Nothing, "", |p| p.set(40, &[5])),
    ("patch size", With::Nothing, "", |p| p.set(41, &[3])),
    ("leaf level", With::Nothing, "leaf level", |p| p.set(42, &[4])),
    ("metric", With::Nothing, "options, metric", |p| p.set(43, &[1])),
    ("metric, of another program", With::Deep, "one-step errors", |p| {
        p.set(43, &[1]);
        p.json(METADATA, |m| m["tool"] = json!("other 1"));
    }),
    ("sample kind", With::Nothing, "float samples", |p| p.set(44, &[2])),
    ("source type too small", With::Nothing, "for the source is", |p| p.set(45, &[2])),
    ("another source type", With::Source, "sample type", |p| p.set(45, &[5])),
    ("scale of codes", With::Nothing, "whole numbers", |p| p.double(48, |_| 1.5)),
    ("offset of codes", With::Source, "source samples", |p| p.double(56, |_| 1.0)),
    ("band scale", With::Nothing, "height range", |p| p.double(64, |s| s * 0.75)),
    ("band offset", With::Nothing, "height range", |p| p.double(72, |_| -1.0)),
    ("unit", With::Nothing, "vertical_unit", |p| p.double(80, |_| 1.0)),
    ("quantised", With::Nothing, "precision_m", |p| {
        p.set(46, &[7]);
        p.double(88, |_| 0.5);
    }),
    ("nodata", With::Nothing, "options, nodata", |p| p.double(96, |_| -9999.0)),
    ("no nodata", With::Source, "nodata", |p| {
        p.set(46, &[1]);
        p.double(96, |_| 0.0);
        p.json(METADATA, |m| m["options"]["nodata"] = Value::Null);
    }),
    ("a valid sample as nodata", With::Nothing, "void, for it is the nodata value", |p| {
        let valid = 500.0;
        p.double(96, |_| valid);
        p.json(METADATA, |m| m["options"]["nodata"] = json!(valid));
    }),
    ("geotransform", With::Nothing, "bounds", |p| p.double(112, |dx| dx * 1.01)),
    ("geotransform and bounds", With::Source, "geotransform", |p| {
        p.double(104, |x0| x0 + 1.0);
        p.json(METADATA, |m| m["bounds"] = json!([11.0, 59.2, 12.0, 60.0]));
    }),
    ("no geotransform", With::Nothing, "bounds", |p| {
        p.set(46, &[2]);
        p.set(104, &[0; 48]);
    }),
    ("tile count", With::Nothing, "tiles in the index", |p| p.set(152, &7_u64.to_le_bytes())),
    ("reserved bytes", With::Nothing, "reserved", |p| p.set(200, &[1])),
];

#[test]
fn lies_in_the_header() {
    tell(&usual(), IN_THE_HEADER);
}

const IN_THE_METADATA: &[Lie] = &[
    ("bounds", With::Nothing, "bounds", |p| p.json(METADATA, |m| *member(m, "/bounds/3") = json!(60.1))),
    ("half a pixel", With::Nothing, "bounds", |p| {
        p.json(METADATA, |m| m["bounds"] = json!([10.005, 59.205, 10.995, 59.995]));
    }),
    ("no bounds", With::Nothing, "bounds", |p| p.json(METADATA, |m| m["bounds"] = Value::Null)),
    ("pixel is point", With::Nothing, "pixel_is_point", |p| {
        p.json(METADATA, |m| m["pixel_is_point"] = json!(false));
    }),
    ("pixel is point, without keys", With::Source, "pixel is point", |p| {
        p.json(METADATA, |m| {
            m["pixel_is_point"] = json!(false);
            m["crs"].as_object_mut().unwrap().remove("keys");
        });
    }),
    ("vertical unit", With::Nothing, "vertical_unit", |p| {
        p.json(METADATA, |m| m["vertical_unit"] = json!("metre"));
    }),
    ("an unknown vertical unit", With::Source, "name of the vertical unit", |p| {
        p.json(METADATA, |m| m["vertical_unit"] = json!("cubit"));
    }),
    ("kind", With::Nothing, "crs, kind", |p| {
        p.json(METADATA, |m| *member(m, "/crs/kind") = json!("projected"));
    }),
    ("epsg", With::Nothing, "crs, epsg", |p| p.json(METADATA, |m| *member(m, "/crs/epsg") = json!(4258))),
    ("wkt", With::Nothing, "crs, ellipsoid", |p| {
        p.json(METADATA, |m| {
            let wkt = m["crs"]["wkt"].as_str().unwrap().replace("6378137", "6377397.155");
            *member(m, "/crs/wkt") = json!(wkt);
        });
    }),
    ("ellipsoid", With::Nothing, "crs, ellipsoid", |p| {
        p.json(METADATA, |m| {
            *member(m, "/crs/ellipsoid") = json!({"a": 6_377_397.155, "inverse_flattening": 299.152_812_8});
        });
    }),
    ("ellipsoid, nothing else", With::Source, "coordinate system", |p| {
        p.json(METADATA, |m| {
            *member(m, "/crs/wkt") = json!("");
            *member(m, "/crs/ellipsoid/a") = json!(6_377_397.155);
        });
    }),
    ("no ellipsoid", With::Nothing, "crs, ellipsoid", |p| {
        p.json(METADATA, |m| *member(m, "/crs/ellipsoid/a") = json!(0.0));
    }),
    ("unit of degrees", With::Nothing, "crs, unit", |p| {
        p.json(METADATA, |m| *member(m, "/crs/unit") = json!(0.015_707_963));
    }),
    ("keys", With::Nothing, "crs, kind", |p| {
        p.json(METADATA, |m| *member(m, "/crs/keys/directory/7") = json!(1));
    }),
    ("vertical system", With::Source, "coordinate system", |p| {
        p.json(METADATA, |m| *member(m, "/crs/vertical_epsg") = json!(5773));
    }),
    ("tile in the options", With::Nothing, "options, tile", |p| {
        p.json(METADATA, |m| *member(m, "/options/tile") = json!(32));
    }),
    ("patch in the options", With::Nothing, "options, patch", |p| {
        p.json(METADATA, |m| *member(m, "/options/patch") = json!(8));
    }),
    ("imagery", With::Nothing, "imagery", |p| p.json(METADATA, |m| m["imagery"] = json!({"pictures": 1}))),
    ("tiles of a level", With::Nothing, "metadata of level 2, tiles", |p| {
        p.json(METADATA, |m| *member(m, "/levels/2/tiles") = json!(3));
    }),
    ("bytes of a level", With::Nothing, "metadata of level 1, bytes", |p| {
        p.json(METADATA, |m| *member(m, "/levels/1/bytes") = json!(3));
    }),
    ("vertical error of a level", With::Nothing, "largest vertical error", |p| {
        p.json(METADATA, |m| *member(m, "/levels/1/max_vertical_m") = json!(0.5));
    }),
    ("horizontal error of a level", With::Nothing, "largest horizontal error", |p| {
        p.json(METADATA, |m| *member(m, "/levels/0/max_horizontal_m") = Value::Null);
    }),
    ("a level too many", With::Nothing, "levels in the metadata", |p| {
        p.json(METADATA, |m| m["levels"].as_array_mut().unwrap().push(json!({})));
    }),
];

#[test]
fn lies_in_the_metadata() {
    tell(&usual(), IN_THE_METADATA);
}

#[test]
fn lies_in_the_statistics() {
    let file = usual();
    // Every number of the section, whatever it is called.
    let mut places = Vec::new();
    file.with(|parts| parts.json(STATISTICS, |statistics| numbers(statistics, String::new(), &mut places)));
    assert!(places.len() > 300, "{places:?}");
    for (index, place) in places.iter().enumerate().filter(|(index, _)| index % 7 == 0) {
        let path = file.with(|parts| {
            parts.json(STATISTICS, |statistics| {
                let number = member(statistics, place);
                *number = match number.as_u64() {
                    Some(count) => json!(count + 1),
                    None => json!(number.as_f64().unwrap() * 1.001 + 0.25),
                };
            });
        });
        let found = report(&path, None, false);
        assert!(!found.is_good(), "number {index}, {place}: nothing was found");
        let found = words(&found);
        assert!(found.contains("statistics"), "{place}: {found}");
    }
    tell(
        &file,
        &[
            ("no range", With::Nothing, "minimum", |p| {
                p.json(STATISTICS, |s| *member(s, "/levels/3/min_m") = Value::Null);
            }),
            ("infinite", With::Nothing, "p99", |p| {
                p.json(STATISTICS, |s| *member(s, "/levels/1/steps/1/vertical/p99") = Value::Null);
            }),
            ("a step left out", With::Nothing, "steps", |p| {
                p.json(STATISTICS, |s| {
                    member(s, "/levels/1/steps").as_array_mut().unwrap().pop();
                });
            }),
            ("a level left out", With::Nothing, "levels", |p| {
                p.json(STATISTICS, |s| {
                    s["levels"].as_array_mut().unwrap().pop();
                });
            }),
        ],
    );
}

/// Places of all numbers in a JSON value, and nothing else: strings and nulls are not statistics.
fn numbers(value: &Value, place: String, out: &mut Vec<String>) {
    match value {
        Value::Number(_) => out.push(place),
        Value::Array(list) => {
            list.iter().enumerate().for_each(|(i, value)| numbers(value, format!("{place}/{i}"), out));
        }
        Value::Object(members) => {
            members.iter().for_each(|(name, value)| numbers(value, format!("{place}/{name}"), out));
        }
        _ => {}
    }
}

#[test]
fn lies_about_imagery() {
    let vector = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/vectors/imagery-png.rlv");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let section = |parts: &mut Parts, edit: &dyn Fn(&mut [u8])| {
        edit(&mut parts.sections.iter_mut().find(|section| section.0 == 16).unwrap().2);
    };
    // Offset and new value of a byte of the imagery's header: section 16.1.
    for (name, at, value) in [
        ("tile size", 0, 68_u8),
        ("gutter", 2, 4),
        ("codec", 3, 2),
        ("quality", 4, 85),
        ("channels", 5, 1),
        ("alpha", 6, 1),
        ("reserved flags", 6, 2),
        ("leaf level", 7, 5),
        ("tile count", 8, 200),
        ("", 0, 64),
    ] {
        let mut parts = Parts::read(&vector);
        section(&mut parts, &|bytes| bytes[at] = if name == "alpha" { bytes[at] ^ value } else { value });
        parts.write(&path);
        let found = report(&path, None, false);
        assert_eq!(found.is_good(), name.is_empty(), "{name}: {}", words(&found));
    }
    for (member, value) in [
        ("codec", json!("webp")),
        ("quality", json!(85)),
        ("tile", json!(512)),
        ("resolution", json!("finer")),
    ] {
        let mut parts = Parts::read(&vector);
        parts.json(METADATA, |metadata| {
            *metadata.pointer_mut(&format!("/imagery/options/{member}")).unwrap() = value;
        });
        parts.write(&path);
        let found = report(&path, None, false);
        // What the layer does not say too cannot be known.
        assert_eq!(found.is_good(), member == "resolution", "{member}: {}", words(&found));
    }
}
