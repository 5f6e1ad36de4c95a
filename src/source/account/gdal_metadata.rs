//! GDAL's XML in TIFF tag 42112: scale, offset, unit and role of bands.

use std::collections::BTreeMap;

use roxmltree::Node;

use super::role::Role;
use super::xml;

/// The properties of a band, as written in the tag.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Items {
    pub(super) scale: Option<String>,
    pub(super) offset: Option<String>,
    pub(super) unit: Option<String>,
    pub(super) role: Option<Role>,
}

/// Reads items such as `<Item name=".." sample="0" role="scale">0.1</Item>`, by band from 1; `Err`
/// if the text is not XML.
pub(super) fn read(text: &str) -> Result<BTreeMap<u32, Items>, String> {
    let items = xml::read(text, "GDALMetadata", |root| {
        let mut found = BTreeMap::new();
        for item in xml::children(root, "Item") {
            take(item, &mut found);
        }
        found
    });
    items.map(Option::unwrap_or_default)
}

fn take(item: Node<'_, '_>, found: &mut BTreeMap<u32, Items>) {
    let domain = xml::attribute(item, "domain").unwrap_or_default();
    // An item without a sample is about the whole file; GDAL ignores an item without a name.
    let (Some(_), Some(sample), Some(text)) =
        (xml::attribute(item, "name"), xml::attribute(item, "sample"), xml::text(item))
    else {
        return;
    };
    let Some(band) = band(sample).filter(|_| !domain.eq_ignore_ascii_case("IMAGE_STRUCTURE")) else { return };
    let items: &mut Items = found.entry(band).or_default();
    // GDAL escapes values twice.
    let text = unescaped(text);
    match xml::attribute(item, "role").unwrap_or_default().to_ascii_lowercase().as_str() {
        "scale" => items.scale = Some(text),
        "offset" => items.offset = Some(text),
        "unittype" => items.unit = Some(text),
        "colorinterp" => items.role = Role::of_name(&text).or(items.role),
        _ => {}
    }
}

/// The number of a band, from 1: the leading digits of a text, or 0, plus one.
fn band(sample: &str) -> Option<u32> {
    let sample = sample.trim_start();
    let digits = sample.strip_prefix('+').unwrap_or(sample);
    let end = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
    match &digits[..end] {
        "" => (!digits.starts_with('-')).then_some(1),
        digits => digits.parse::<u16>().ok().map(|sample| u32::from(sample) + 1),
    }
}

/// The text with XML references resolved once more.
fn unescaped(text: &str) -> String {
    let mut parts = text.split('&');
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        if let Some((name, rest)) = part.split_once(';')
            && let Some(character) = character(name)
        {
            plain.push(character);
            plain.push_str(rest);
        } else {
            plain.push('&');
            plain.push_str(part);
        }
    }
    plain
}

/// The character of an XML reference, given without its `&` and `;`.
fn character(name: &str) -> Option<char> {
    Some(match name {
        "lt" => '<',
        "gt" => '>',
        "amp" => '&',
        "quot" => '"',
        "apos" => '\'',
        _ => {
            let code = name.strip_prefix('#')?;
            let code = match code.strip_prefix(['x', 'X']) {
                Some(hex) => u32::from_str_radix(hex, 16).ok()?,
                None => code.parse().ok()?,
            };
            char::from_u32(code)?
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first(inside: &str) -> Items {
        let mut all = read(&format!("<GDALMetadata>{inside}</GDALMetadata>")).expect("XML");
        all.remove(&1).unwrap_or_default()
    }

    fn scale(text: &str) -> Items {
        Items { scale: Some(text.to_owned()), ..Items::default() }
    }

    #[test]
    fn items_of_bands() {
        let all = read(
            "<GDALMetadata>\n  <Item name=\"OFFSET\" sample=\"0\" role=\"offset\">100</Item>\n\
             <Item role='scale' sample='0' name='SCALE'>0.25</Item>\n\
             <Item name=\"SCALE\" sample=\"1\" role=\"scale\">9</Item>\n\
             <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">a &lt;b&gt; &amp;amp;</Item>\n\
             <Item name=\"COLORINTERP\" sample=\"1\" role=\"colorinterp\">Blue</Item>\n\
             <Item name=\"sample\">0</Item></GDALMetadata>",
        );
        let one = Items {
            scale: Some("0.25".to_owned()),
            offset: Some("100".to_owned()),
            unit: Some("a <b> &".to_owned()),
            role: None,
        };
        let two = Items { role: Some(Role::Blue), ..scale("9") };
        assert_eq!(all, Ok(BTreeMap::from([(1, one), (2, two)])));
    }

    #[test]
    fn liberties_of_gdal() {
        for same in [
            "<Item name=\"S\" sample=\"0\" role=\"SCALE\">9</Item>",
            "<item NAME=\"S\" SAMPLE=\"0\" ROLE=\"Scale\">9</item>",
            "<Item name=\"S\" sample=\"0\" role=\"scale\"><![CDATA[9]]></Item>",
            "<Item name=\"S\" sample=\"0\" role=\"scale\">&#57;</Item>",
            "<Item name=\"S\" sample=\"0\" role=\"scale\">&amp;#x39;</Item>",
            "<Item name=\"S\" sample=\" 0x\" role=\"scale\">9</Item>",
            "<Item name=\"S\" sample=\"\" role=\"scale\">9</Item>",
            "<Item name=\"S\" sample=\"0\" role=\"scale\" domain=\"x\">9</Item>",
            "<Item name=\"S\" sample=\"0\" role=\"scale\">8</Item><Item name=\"S\" sample=\"0\" role=\"scale\">9</Item>",
            "<Item name=\"S\" sample=\"0\" role=\"scale\">9</Item><Item name=\"d\">a & b</Item>",
        ] {
            assert_eq!(first(same), scale("9"), "{same}");
        }
        for nothing in [
            "<!-- <Item name=\"S\" sample=\"0\" role=\"scale\">9</Item> -->",
            "<Item sample=\"0\" role=\"scale\">9</Item>",
            "<Item name=\"S\" role=\"scale\">9</Item>",
            "<Item name=\"S\" sample=\"-1\" role=\"scale\">9</Item>",
            "<Item name=\"S\" sample=\"99999999999\" role=\"scale\">9</Item>",
            "<Item name=\"S\" sample=\"0\" role=\"scale\"></Item>",
            "<Item name=\"S\" sample=\"0\" role=\"scale\">9<!-- x --></Item>",
            "<Item name=\"S\" sample=\"0\" role=\" scale\">9</Item>",
            "<Item name=\"S\" sample=\"0\" role=\"scale\" domain=\"IMAGE_STRUCTURE\">9</Item>",
            "<X><Item name=\"S\" sample=\"0\" role=\"scale\">9</Item></X>",
        ] {
            assert_eq!(first(nothing), Items::default(), "{nothing}");
        }
        assert!(read("<GDALMetadata><Item name=\"S\" sample=\"0\" role=\"scale\">9</Item>").is_err());
        assert_eq!(unescaped("&amp;&#65;&#x42;&nothing;&"), "&AB&nothing;&");
    }
}
