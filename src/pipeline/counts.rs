//! [`Counts`]: how many patches have an error of each code.
//!
//! Codes are counted a dozen times for every patch of a build. So each code has a counter of its
//! own, in pages of codes that are near each other.

use std::collections::BTreeMap;

/// Codes of a page, as many as a bin of the histogram has.
const PAGE: usize = 64;

/// Counts by code.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Counts {
    /// Pages without a count are `None`; the last one has a count.
    pages: Vec<Option<Box<[u64; PAGE]>>>,
}

impl Counts {
    /// Adds `count` to a code.
    pub fn add(&mut self, code: u16, count: u64) {
        if count == 0 {
            return;
        }
        let (page, place) = (usize::from(code) / PAGE, usize::from(code) % PAGE);
        if page >= self.pages.len() {
            self.pages.resize_with(page + 1, || None);
        }
        self.pages[page].get_or_insert_with(|| Box::new([0; PAGE]))[place] += count;
    }

    /// The codes that were counted, in order, each with its count.
    pub fn iter(&self) -> impl Iterator<Item = (u16, u64)> + '_ {
        let pages =
            (0..).step_by(PAGE).zip(&self.pages).filter_map(|(first, page)| Some((first, page.as_ref()?)));
        pages
            .flat_map(|(first, page)| (first..).zip(page.iter().copied()))
            .filter(|&(_, count)| count > 0)
            .map(|(code, count): (usize, u64)| (code as u16, count))
    }
}

impl From<BTreeMap<u16, u64>> for Counts {
    fn from(counts: BTreeMap<u16, u64>) -> Self {
        let mut all = Self::default();
        for (code, count) in counts {
            all.add(code, count);
        }
        all
    }
}

impl From<&Counts> for BTreeMap<u16, u64> {
    fn from(counts: &Counts) -> Self {
        counts.iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn codes_are_counted_as_a_map_does(codes in prop::collection::vec((any::<u16>(), 0..3_u64), 0..200)) {
            let (mut counts, mut map) = (Counts::default(), BTreeMap::new());
            for (code, count) in codes {
                counts.add(code, count);
                *map.entry(code).or_default() += count;
            }
            map.retain(|_, count| *count > 0);
            prop_assert_eq!(counts.iter().collect::<BTreeMap<_, _>>(), map.clone());
            prop_assert_eq!(Counts::from(map.clone()), counts.clone());
            prop_assert_eq!(BTreeMap::from(&counts), map);
        }
    }
}
