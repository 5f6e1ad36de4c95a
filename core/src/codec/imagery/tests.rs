use super::*;

/// Numbers that look random.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 33
    }

    fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }
}

/// Something like a picture: waves, an edge and some noise.
fn picture(side: usize, kind: Colour, alpha: u8, seed: u64) -> Texels {
    let mut random = Random(seed);
    let (a, b) = (random.below(20) as f32 + 5.0, random.below(20) as f32 + 5.0);
    let mut colour = Vec::new();
    for y in 0..side {
        for x in 0..side {
            let wave = 60.0 * ((x as f32 / a).sin() + (y as f32 / b).cos());
            let edge = if x > y { 20.0 } else { 0.0 };
            for channel in 0..kind.channels() {
                let noise = random.below(8) as f32 + 7.0 * channel as f32;
                colour.push((110.0 + wave + edge + noise).clamp(0.0, 255.0) as u8);
            }
        }
    }
    let mut clear = |i: usize| match alpha {
        1 => 255 * u8::from((i / side).pow(2) + (i % side).pow(2) < side * side),
        _ => (random.below(3) * 100 + (i % side / 8) as u64) as u8,
    };
    let alpha = (alpha > 0).then(|| (0..side * side).map(&mut clear).collect());
    Texels { side, kind, colour, alpha }
}

fn form(codec: Codec, colour: Colour, side: usize, quality: u8) -> Form {
    Form { codec, quality: if codec == Codec::Jpeg { quality } else { 0 }, colour, side }
}

fn psnr(a: &[u8], b: &[u8]) -> f64 {
    let square = |(a, b): (&u8, &u8)| (f64::from(*a) - f64::from(*b)).powi(2);
    let error = a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64;
    10.0 * (255.0_f64.powi(2) / error.max(1e-9)).log10()
}

#[test]
fn texels_come_back() {
    for codec in Codec::ALL {
        for kind in [Colour::Grey, Colour::Rgb] {
            for (side, alpha) in [(68, 0), (68, 1), (260, 2), (256, 0), (100, 1)] {
                let texels = picture(side, kind, alpha, side as u64);
                let form = form(codec, kind, side, 85);
                let tables = jpeg_tables(&form).unwrap();
                let chunks = encode(&form, &texels).unwrap();
                assert!(chunks.colour.len() as u64 <= form.max_chunk_bytes());
                let back = decode(&form, tables.as_ref(), &chunks.colour, &chunks.alpha).unwrap();
                let name = format!("{codec} {kind:?} {side} {alpha}");
                assert_eq!((back.side, back.kind), (side, kind), "{name}");
                assert!(back.alpha == texels.alpha, "{name}");
                if codec.is_lossless() {
                    assert!(back.colour == texels.colour, "{name}");
                } else {
                    let db = psnr(&back.colour, &texels.colour);
                    assert!(
                        db > if codec == Codec::Bc7 && alpha == 2 { 20.0 } else { 32.0 },
                        "{name}: {db} dB"
                    );
                }
            }
        }
    }
}

#[test]
fn an_alpha_of_nothing_but_opaque_texels_is_none() {
    for codec in Codec::ALL {
        let form = form(codec, Colour::Rgb, 64, 80);
        let plain = picture(64, Colour::Rgb, 0, 5);
        let opaque = Texels { alpha: Some(vec![255; 64 * 64]), ..plain.clone() };
        assert_eq!(encode(&form, &opaque).unwrap(), encode(&form, &plain).unwrap());
    }
}

#[test]
fn fitted_tables_change_the_bytes_and_not_the_picture() {
    for (kind, quality, side) in [(Colour::Rgb, 85, 260), (Colour::Rgb, 95, 100), (Colour::Grey, 60, 256)] {
        let form = form(Codec::Jpeg, kind, side, quality);
        let standard = jpeg_tables(&form).unwrap().unwrap();
        let tiles: Vec<_> =
            (0..4).map(|seed| encode(&form, &picture(side, kind, seed as u8 % 2, seed)).unwrap()).collect();
        let mut histograms = Histograms::default();
        for chunks in &tiles {
            standard.count(chunks, &mut histograms).unwrap();
        }
        let fitted = standard.fitted(&form, &histograms).unwrap();
        let mut sizes = (0, 0);
        for chunks in &tiles {
            let recoded = standard.recode(&fitted, &chunks.colour).unwrap();
            let before = decode(&form, Some(&standard), &chunks.colour, &chunks.alpha).unwrap();
            let after = decode(&form, Some(&fitted), &recoded, &chunks.alpha).unwrap();
            assert!(before == after, "{kind:?} {quality}");
            assert_eq!(fitted.recode(&standard, &recoded).unwrap(), chunks.colour);
            sizes = (sizes.0 + chunks.colour.len(), sizes.1 + recoded.len());
        }
        assert!(sizes.1 < sizes.0, "{sizes:?}");
        // What is not in the tables cannot be coded with them.
        let noise: Vec<u8> = {
            let mut random = Random(77);
            (0..side * side * kind.channels()).map(|_| random.below(256) as u8).collect()
        };
        let noise = encode(&form, &Texels { side, kind, colour: noise, alpha: None }).unwrap();
        let recoded = standard.recode(&fitted, &noise.colour);
        if let Ok(recoded) = recoded {
            assert_eq!(fitted.recode(&standard, &recoded).unwrap(), noise.colour);
        }
    }
}

#[test]
fn huffman_codes_are_complete_but_for_one() {
    let mut random = Random(3);
    for turn in 0..50 {
        let mut histograms = Histograms::default();
        for counts in &mut histograms.0 {
            for count in counts.iter_mut().take(1 + turn * 5) {
                // A wide range of counts asks for codes beyond 16 bits.
                *count = 1 << random.below(40);
            }
        }
        for code in histograms.codes() {
            let used: u64 =
                code.lengths.iter().zip(1..).map(|(&n, bits): (_, u32)| u64::from(n) << (16 - bits)).sum();
            assert!(used < 1 << 16, "all ones is taken");
            assert_eq!(code.symbols.len(), 1 + turn * 5);
        }
    }
}

#[test]
fn other_tiles_are_refused() {
    let form = form(Codec::Png, Colour::Rgb, 64, 0);
    assert!(encode(&form, &picture(68, Colour::Rgb, 0, 1)).is_err());
    assert!(encode(&form, &picture(64, Colour::Grey, 0, 1)).is_err());
    let mut cut = picture(64, Colour::Rgb, 0, 1);
    cut.colour.pop();
    assert!(encode(&form, &cut).is_err());
}

#[test]
fn a_picture_of_another_size_is_refused_before_it_is_decoded() {
    for codec in [Codec::Jpeg, Codec::Webp, Codec::Png, Codec::Bc7, Codec::Bc1] {
        let large = form(codec, Colour::Rgb, 512, 85);
        let small = form(codec, Colour::Rgb, 64, 85);
        let chunks = encode(&large, &picture(512, Colour::Rgb, 1, 3)).unwrap();
        if let Some(tables) = jpeg_tables(&large).unwrap() {
            assert!(JpegTables::parse(&small, tables.prefix()).is_err());
        } else {
            assert!(decode(&small, None, &chunks.colour, &[]).is_err());
        }
        if !chunks.alpha.is_empty() {
            assert!(alpha::decode(64, &chunks.alpha).is_err());
        }
    }
}

#[test]
fn damaged_bytes_give_errors_or_other_texels_and_no_panic() {
    for codec in Codec::ALL {
        for kind in [Colour::Grey, Colour::Rgb] {
            let form = form(codec, kind, 68, 85);
            let tables = jpeg_tables(&form).unwrap();
            let good = encode(&form, &picture(68, kind, 1, 8)).unwrap();
            let mut random = Random(1);
            for _ in 0..300 {
                let mut bad = good.clone();
                let part = if bad.alpha.is_empty() || random.below(3) > 0 {
                    &mut bad.colour
                } else {
                    &mut bad.alpha
                };
                match random.below(4) {
                    0 => part.truncate(random.below(part.len() as u64) as usize),
                    1 => part.extend([0xFF, 0xD9, 0, 7]),
                    _ => {
                        for _ in 0..=random.below(4) {
                            let at = random.below(part.len() as u64) as usize;
                            part[at] ^= 1 << random.below(8);
                        }
                    }
                }
                if let Ok(texels) = decode(&form, tables.as_ref(), &bad.colour, &bad.alpha) {
                    assert_eq!(texels.colour.len(), 68 * 68 * kind.channels());
                }
                if let Some(tables) = &tables {
                    let _ = tables.count(&bad, &mut Histograms::default());
                    let mut prefix = tables.prefix().to_vec();
                    let at = random.below(prefix.len() as u64) as usize;
                    prefix[at] = random.next() as u8;
                    if let Ok(odd) = JpegTables::parse(&form, &prefix) {
                        let _ = decode(&form, Some(&odd), &good.colour, &[]);
                        let _ = tables.recode(&odd, &good.colour);
                    }
                    prefix.truncate(at);
                    assert!(JpegTables::parse(&form, &prefix).is_err(), "cut at {at}");
                }
            }
        }
    }
}
