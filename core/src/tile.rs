//! Tiles of the quadtree: their ids, their order, and how their lattices nest.

/// Level, column and row of a tile; level 0 is the root, x grows east, y south.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileId {
    /// Level, 0 at the root.
    pub level: u8,
    /// Column, below `2^level`.
    pub x: u32,
    /// Row, below `2^level`.
    pub y: u32,
}

impl TileId {
    /// The one tile of level 0.
    pub const ROOT: Self = Self { level: 0, x: 0, y: 0 };

    /// The tile of these coordinates.
    pub fn new(level: u8, x: u32, y: u32) -> Self {
        Self { level, x, y }
    }

    /// The tile of which this one is a quadrant; `None` for the root.
    ///
    /// ```
    /// use relevo_core::TileId;
    ///
    /// assert_eq!(TileId::new(2, 3, 1).parent(), Some(TileId::new(1, 1, 0)));
    /// assert_eq!(TileId::ROOT.parent(), None);
    /// ```
    pub fn parent(self) -> Option<Self> {
        (self.level > 0).then(|| Self::new(self.level - 1, self.x / 2, self.y / 2))
    }

    /// Quadrant 0..4 (north-west, north-east, south-west, south-east) of this tile.
    ///
    /// ```
    /// use relevo_core::TileId;
    ///
    /// assert_eq!(TileId::ROOT.child(2), TileId::new(1, 0, 1));
    /// ```
    #[must_use]
    pub fn child(self, quadrant: u8) -> Self {
        Self::new(self.level + 1, 2 * self.x + u32::from(quadrant & 1), 2 * self.y + u32::from(quadrant >> 1))
    }

    /// The quadrant of its parent that this tile is.
    ///
    /// ```
    /// use relevo_core::TileId;
    ///
    /// assert_eq!(TileId::ROOT.child(3).quadrant(), 3);
    /// ```
    pub fn quadrant(self) -> u8 {
        (self.x & 1) as u8 | ((self.y & 1) as u8) << 1
    }

    /// Position on the Hilbert curve of its level: the storage order.
    pub fn hilbert(self) -> u64 {
        let (mut x, mut y) = (u64::from(self.x), u64::from(self.y));
        let mut position = 0;
        for bit in (0..self.level).rev() {
            let side = 1_u64 << bit;
            let (rx, ry) = (u64::from(x & side != 0), u64::from(y & side != 0));
            position += side * side * ((3 * rx) ^ ry);
            // Turn the quadrant so that its curve starts where the last one ends.
            x &= side - 1;
            y &= side - 1;
            if ry == 0 {
                if rx == 1 {
                    (x, y) = (side - 1 - x, side - 1 - y);
                }
                std::mem::swap(&mut x, &mut y);
            }
        }
        position
    }
}

impl std::fmt::Display for TileId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}/{}", self.level, self.x, self.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hilbert_visits_every_tile_once_in_single_steps() {
        for level in 0..6 {
            let side = 1_u32 << level;
            let mut tiles: Vec<_> =
                (0..side * side).map(|i| TileId::new(level, i % side, i / side)).collect();
            tiles.sort_by_key(|tile| tile.hilbert());
            for (position, tile) in tiles.iter().enumerate() {
                assert_eq!(tile.hilbert(), position as u64);
            }
            for pair in tiles.windows(2) {
                assert_eq!(pair[0].x.abs_diff(pair[1].x) + pair[0].y.abs_diff(pair[1].y), 1);
            }
        }
    }

    #[test]
    fn children_know_their_parent() {
        let tile = TileId::new(3, 5, 2);
        for quadrant in 0..4 {
            assert_eq!(tile.child(quadrant).parent(), Some(tile));
            assert_eq!(tile.child(quadrant).quadrant(), quadrant);
        }
        assert_eq!(TileId::ROOT.parent(), None);
    }
}
