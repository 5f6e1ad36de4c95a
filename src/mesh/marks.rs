//! Sets of vertices, and their numbers.
//!
//! Bits in blocks of 256 x 256 vertices; a block exists if one of its bits is set. Vertices of
//! scale 256 and more are kept in blocks of their own, 256 times as wide, and so on, so that a
//! coarse mesh of a large lattice takes little. A full set takes one bit a vertex.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use super::vertex::Vertex;

/// Bits of the coordinates within a block.
const BITS: u32 = 8;
/// Vertices on a side of a block.
const SIDE: u32 = 1 << BITS;
/// Words of a block.
const WORDS: usize = (SIDE * SIDE / 64) as usize;

/// The hash of a number that is spread enough by a product.
#[derive(Default)]
pub(super) struct Spread(u64);

impl Hasher for Spread {
    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 32)
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_u64(byte.into());
        }
    }

    fn write_u64(&mut self, number: u64) {
        self.0 = (self.0 ^ number).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    }
}

/// A map by block.
type Map<V> = HashMap<u64, V, BuildHasherDefault<Spread>>;

/// Where a vertex is kept: its layer, block and bit.
#[derive(Clone, Copy)]
struct Place {
    layer: usize,
    block: u64,
    bit: u32,
}

impl Place {
    /// The place of a vertex in one of `layers` layers.
    fn of(vertex: Vertex, layers: usize) -> Self {
        let layer = ((vertex.scale().trailing_zeros() / BITS) as usize).min(layers - 1);
        let shift = BITS * layer as u32;
        let (x, y) = (vertex.x >> shift, vertex.y >> shift);
        let block = u64::from(y >> BITS) << 32 | u64::from(x >> BITS);
        Self { layer, block, bit: (y % SIDE) * SIDE + x % SIDE }
    }

    /// The vertex that is kept here.
    fn vertex(self) -> Vertex {
        let shift = BITS * self.layer as u32;
        let (x, y) =
            (self.block as u32 * SIDE + self.bit % SIDE, (self.block >> 32) as u32 * SIDE + self.bit / SIDE);
        Vertex::new(x << shift, y << shift)
    }
}

/// A set of vertices of a lattice.
#[derive(Debug)]
pub struct Marks {
    layers: Vec<Map<Box<[u64; WORDS]>>>,
}

impl Marks {
    /// The empty set of vertices of a lattice of `side` intervals.
    pub fn new(side: u32) -> Self {
        let layers = side.max(1).ilog2() / BITS + 1;
        Self { layers: (0..layers).map(|_| Map::default()).collect() }
    }

    /// Adds a vertex. Returns true if it was not there.
    pub fn add(&mut self, vertex: Vertex) -> bool {
        let place = Place::of(vertex, self.layers.len());
        let words = self.layers[place.layer].entry(place.block).or_insert_with(|| Box::new([0; WORDS]));
        let (word, bit) = (&mut words[(place.bit / 64) as usize], 1 << (place.bit % 64));
        let is_new = *word & bit == 0;
        *word |= bit;
        is_new
    }

    /// Adds a vertex, its parents in a lattice of `side` intervals, theirs and so on.
    pub fn add_with_parents(&mut self, vertex: Vertex, side: u32) {
        if !self.add(vertex) {
            return;
        }
        let mut waiting = vec![vertex];
        while let Some(vertex) = waiting.pop() {
            waiting.extend(vertex.parents(side).filter(|&parent| self.add(parent)));
        }
    }

    /// Adds all vertices of another set of the same lattice.
    pub fn join(&mut self, other: Self) {
        for (mine, theirs) in self.layers.iter_mut().zip(other.layers) {
            for (block, words) in theirs {
                match mine.entry(block) {
                    std::collections::hash_map::Entry::Vacant(free) => {
                        free.insert(words);
                    }
                    std::collections::hash_map::Entry::Occupied(mut there) => {
                        there.get_mut().iter_mut().zip(&words[..]).for_each(|(mine, theirs)| *mine |= theirs);
                    }
                }
            }
        }
    }

    /// The set with its vertices numbered: coarse layers first, blocks along a Z curve, rows from
    /// the north.
    pub fn number(self) -> Numbered {
        let mut numbered = Numbered { layers: Vec::new(), blocks: Vec::new(), count: 0 };
        for (layer, mut blocks) in self.layers.into_iter().enumerate().rev() {
            let mut keys: Vec<u64> = blocks.keys().copied().collect();
            keys.sort_unstable_by_key(|&key| (interleave(key as u32, (key >> 32) as u32), key));
            let mut places = Map::default();
            for key in keys {
                let Some(bits) = blocks.remove(&key) else { continue };
                let mut before = Box::new([0; WORDS]);
                let mut count = 0_u32;
                for (before, word) in before.iter_mut().zip(&bits[..]) {
                    // At most 65 535 of the block's 65 536 bits come before its last word.
                    *before = count as u16;
                    count += word.count_ones();
                }
                places.insert(key, numbered.blocks.len());
                numbered.blocks.push(Block { layer, key, first: numbered.count, bits, before });
                numbered.count += u64::from(count);
            }
            numbered.layers.push(places);
        }
        numbered.layers.reverse();
        numbered
    }
}

/// True if a bit is set.
fn has(words: &[u64], bit: u32) -> bool {
    words[(bit / 64) as usize] >> (bit % 64) & 1 == 1
}

/// The bits of `x` in the even places and those of `y` in the odd ones.
pub(super) fn interleave(x: u32, y: u32) -> u64 {
    let spread = |number: u32| {
        let mut wide = u64::from(number);
        for (shift, mask) in [
            (16, 0x0000_FFFF_0000_FFFF),
            (8, 0x00FF_00FF_00FF_00FF),
            (4, 0x0F0F_0F0F_0F0F_0F0F),
            (2, 0x3333_3333_3333_3333),
            (1, 0x5555_5555_5555_5555_u64),
        ] {
            wide = (wide | wide << shift) & mask;
        }
        wide
    };
    spread(x) | spread(y) << 1
}

/// A block of a numbered set.
#[derive(Debug)]
struct Block {
    layer: usize,
    key: u64,
    /// Number of its first vertex.
    first: u64,
    bits: Box<[u64; WORDS]>,
    /// Vertices of the block before each word.
    before: Box<[u16; WORDS]>,
}

impl Block {
    /// The vertices of the block, in the order of their numbers.
    fn vertices(&self) -> impl Iterator<Item = Vertex> {
        self.bits.iter().enumerate().flat_map(move |(number, &word)| {
            let rest = std::iter::successors(Some(word), |word| Some(word & word.checked_sub(1)?));
            rest.take_while(|&word| word != 0).map(move |word| {
                let bit = number as u32 * 64 + word.trailing_zeros();
                Place { layer: self.layer, block: self.key, bit }.vertex()
            })
        })
    }
}

/// A set of vertices with numbers from 0.
#[derive(Debug)]
pub struct Numbered {
    layers: Vec<Map<usize>>,
    blocks: Vec<Block>,
    count: u64,
}

impl Numbered {
    /// How many vertices there are.
    pub fn len(&self) -> u64 {
        self.count
    }

    /// True if a vertex is in the set.
    pub fn contains(&self, vertex: Vertex) -> bool {
        self.number_of(vertex).is_some()
    }

    /// The number of a vertex; `None` if it is not in the set.
    pub fn number_of(&self, vertex: Vertex) -> Option<u64> {
        let place = Place::of(vertex, self.layers.len());
        let block = &self.blocks[*self.layers[place.layer].get(&place.block)?];
        let word = (place.bit / 64) as usize;
        let below = block.bits[word] & ((1 << (place.bit % 64)) - 1);
        has(&block.bits[..], place.bit)
            .then(|| block.first + u64::from(block.before[word]) + u64::from(below.count_ones()))
    }

    /// The vertices in the order of their numbers.
    pub fn vertices(&self) -> impl Iterator<Item = Vertex> {
        self.blocks.iter().flat_map(Block::vertices)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_set_is_a_set(
            places in prop::collection::vec((0_u32..=1 << 20, 0_u32..=1 << 20, 0_u32..20), 1..200),
            others in prop::collection::vec((0_u32..=1 << 20, 0_u32..=1 << 20, 0_u32..20), 1..50),
        ) {
            let vertex = |&(x, y, coarse): &(u32, u32, u32)| Vertex::new(x >> coarse << coarse, y >> coarse << coarse);
            let mut marks = Marks::new(1 << 20);
            let mut expected = BTreeSet::new();
            for vertex in places.iter().map(vertex) {
                prop_assert_eq!(marks.add(vertex), expected.insert(vertex));
            }
            let mut second = Marks::new(1 << 20);
            for vertex in others.iter().map(vertex) {
                second.add(vertex);
            }
            marks.join(second);
            expected.extend(others.iter().map(vertex));
            let numbered = marks.number();
            prop_assert_eq!(numbered.len(), expected.len() as u64);
            for (number, vertex) in numbered.vertices().enumerate() {
                prop_assert!(expected.contains(&vertex));
                prop_assert_eq!(numbered.number_of(vertex), Some(number as u64));
            }
            prop_assert_eq!(numbered.vertices().collect::<BTreeSet<_>>(), expected);
        }
    }

    #[test]
    fn a_full_block_counts_its_bits() {
        let mut marks = Marks::new(256);
        for y in 0..=256 {
            for x in 0..=256 {
                marks.add(Vertex::new(x, y));
            }
        }
        let numbered = marks.number();
        assert_eq!(numbered.len(), 257 * 257);
        let numbers: BTreeSet<_> = numbered.vertices().map(|vertex| numbered.number_of(vertex)).collect();
        assert_eq!(numbers.len(), 257 * 257);
    }

    #[test]
    fn parents_come_with_a_vertex() {
        let mut marks = Marks::new(16);
        marks.add_with_parents(Vertex::new(5, 7), 16);
        let numbered = marks.number();
        for vertex in numbered.vertices() {
            assert!(vertex.parents(16).all(|parent| numbered.contains(parent)), "{vertex:?}");
        }
        assert!(numbered.contains(Vertex::new(8, 8)));
    }
}
