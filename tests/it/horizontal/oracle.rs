//! The smallest tables of horizontal errors that are true, by brute force on parts of an interval.

use relevo::TileId;
use relevo::container::Reader;
use relevo::error_code::metres_from_code;
use relevo::sample::VALID;

use super::ground::{Ground, Point, about};

/// A stored error beside the truth, metres.
#[derive(Clone, Copy, Debug)]
#[expect(dead_code, reason = "id, patch and step are printed by Debug where a test fails")]
pub struct Ratio {
    pub id: TileId,
    pub patch: (usize, usize),
    pub step: usize,
    pub stored: f64,
    /// Of the step itself: of points that are misdrawn.
    pub truth: f64,
    /// Of the smallest monotone table: of those that are, and of limits of them.
    pub least: f64,
    /// The same, if of the outline no more is known than what lies within the leaf tile of a point,
    /// for spacings up to a leaf tile: what a program can know that makes leaf tiles one by one.
    pub of_tile: f64,
    /// True if the patch is not wholly within the raster.
    pub at_edge: bool,
}

/// A piece of the outline.
#[derive(Clone, Copy)]
struct Piece {
    /// The leaf tile that it is in, column and row.
    tile: (usize, usize),
    ends: [Point; 2],
    /// Its ends and its middle.
    marks: [[f64; 4]; 3],
    length: f64,
}

/// Parts of an interval; fewer where distances are integrals.
const QUARTERS: usize = 4;
const HALVES: usize = 2;

pub struct Oracle {
    /// Intervals of the root.
    side: usize,
    size: (usize, usize),
    valid: Vec<bool>,
    ground: Ground,
    /// Intervals of a tile.
    tile: usize,
    /// To an interval.
    parts: usize,
    /// Of each point on quarters: validity at full resolution, the distance from the outline, and
    /// the leaf tile of its nearest piece.
    points: Vec<(f64, f64, (usize, usize))>,
    /// Of each leaf tile, row by row, of each of its points on quarters: the distance from the
    /// outline within the tile.
    of_tiles: Vec<Vec<f64>>,
}

impl Oracle {
    pub fn new(reader: &Reader, ground: Ground) -> Self {
        let header = reader.header();
        let side = (header.tile() << header.levels) as usize;
        let mut valid = vec![false; (side + 1) * (side + 1)];
        for id in reader.tiles(header.levels).expect("tiles") {
            let (lattice, (left, top)) = (reader.read_tile(id).expect("tile"), header.origin(id));
            for (x, y) in (0..=lattice.n).flat_map(|y| (0..=lattice.n).map(move |x| (x, y))) {
                let at = (top as usize + y) * (side + 1) + left as usize + x;
                valid[at] = lattice.state[lattice.at(x, y)] == VALID;
            }
        }
        let size = (header.width as usize, header.height as usize);
        let parts = if ground.degrees { HALVES } else { QUARTERS };
        let tile = header.tile() as usize;
        let (points, of_tiles) = (Vec::new(), Vec::new());
        let mut oracle = Self { side, size, valid, ground, tile, parts, points, of_tiles };
        let (pieces, across) = (oracle.pieces(), oracle.parts * side + 1);
        let misdrawn: Vec<bool> = oracle.misdrawn_at_all(across);
        oracle.points = (0..across * across)
            .map(|i| {
                let (x, y) = oracle.part(i, across);
                let full = oracle.validity(1, x, y);
                let (distance, tile) =
                    if misdrawn[i] { oracle.nearest((x, y), &pieces) } else { (0.0, (0, 0)) };
                (full, distance, tile)
            })
            .collect();
        let tiles = side / tile;
        oracle.of_tiles =
            (0..tiles * tiles).map(|i| oracle.of_tile((i % tiles, i / tiles), &pieces)).collect();
        oracle
    }

    fn part(&self, i: usize, across: usize) -> Point {
        ((i % across) as f64 / self.parts as f64, (i / across) as f64 / self.parts as f64)
    }

    /// Distances of the points of a leaf tile from the outline within it.
    fn of_tile(&self, at: (usize, usize), pieces: &[Piece]) -> Vec<f64> {
        let (across, own) = (self.parts * self.side + 1, self.parts * self.tile);
        let within: Vec<Piece> = pieces.iter().filter(|piece| piece.tile == at).copied().collect();
        let points = (0..=own).flat_map(|y| (0..=own).map(move |x| (at.0 * own + x, at.1 * own + y)));
        let distance = |(x, y): (usize, usize)| {
            let i = y * across + x;
            let (_, distance, tile) = self.points[i];
            if distance == 0.0 || tile == at {
                return distance;
            }
            self.nearest(self.part(i, across), &within).0
        };
        points.map(distance).collect()
    }

    fn misdrawn_at_all(&self, across: usize) -> Vec<bool> {
        let spacings: Vec<usize> =
            (1..usize::BITS).map(|k| 1_usize << k).take_while(|&s| s <= self.side).collect();
        let misdrawn = |i: usize| {
            let (x, y) = self.part(i, across);
            let full = self.validity(1, x, y);
            spacings.iter().any(|&s| limit(full, self.validity(s, x, y)))
        };
        (0..across * across).map(misdrawn).collect()
    }

    /// Validity of the surface drawn at spacing `s`.
    fn validity(&self, s: usize, x: f64, y: f64) -> f64 {
        let size = s as f64;
        let last = self.side / s - 1;
        let (i, j) = (((x / size) as usize).min(last), ((y / size) as usize).min(last));
        let at = |i: usize, j: usize| f64::from(u8::from(self.valid[j * s * (self.side + 1) + i * s]));
        let (u, v) = (x / size - i as f64, y / size - j as f64);
        let (nw, ne, sw, se) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
        if (i + j) % 2 == 0 {
            if u > v { nw + u * (ne - nw) + v * (se - ne) } else { nw + v * (sw - nw) + u * (se - sw) }
        } else if u + v < 1.0 {
            nw + u * (ne - nw) + v * (sw - nw)
        } else {
            se + (1.0 - u) * (sw - se) + (1.0 - v) * (ne - se)
        }
    }

    /// The outline at full resolution.
    fn pieces(&self) -> Vec<Piece> {
        let mut pieces = Vec::new();
        for (i, j) in (0..self.side).flat_map(|j| (0..self.side).map(move |i| (i, j))) {
            let corner = |x: usize, y: usize| (x as f64, y as f64, self.valid[y * (self.side + 1) + x]);
            let [nw, ne, sw, se] = [corner(i, j), corner(i + 1, j), corner(i, j + 1), corner(i + 1, j + 1)];
            let triangles =
                if (i + j) % 2 == 0 { [[nw, ne, se], [nw, sw, se]] } else { [[nw, ne, sw], [ne, sw, se]] };
            for [a, b, c] in triangles {
                let sides = [(a, b), (b, c), (c, a)].into_iter().filter(|(p, q)| p.2 != q.2);
                let middles: Vec<Point> =
                    sides.map(|(p, q)| (0.5 * (p.0 + q.0), 0.5 * (p.1 + q.1))).collect();
                if let [p, q] = middles[..] {
                    let marks =
                        [p, (0.5 * (p.0 + q.0), 0.5 * (p.1 + q.1)), q].map(|point| self.ground.mark(point));
                    let tile = (i / self.tile, j / self.tile);
                    pieces.push(Piece { tile, ends: [p, q], marks, length: about(&marks[0], &marks[2]) });
                }
            }
        }
        pieces
    }

    /// Distance of the nearest of some pieces, and the leaf tile that it is in.
    fn nearest(&self, point: Point, pieces: &[Piece]) -> (f64, (usize, usize)) {
        let from = self.ground.mark(point);
        let away =
            |piece: &Piece| piece.marks.iter().map(|mark| about(&from, mark)).fold(f64::INFINITY, f64::min);
        let away: Vec<f64> = pieces.iter().map(away).collect();
        let least = away.iter().copied().fold(f64::INFINITY, f64::min);
        // A quarter of a piece may lie between two of its marks and the point.
        let near =
            pieces.iter().zip(&away).filter(|(piece, away)| **away - 0.25 * piece.length <= least * 1.03);
        let near = near.map(|(piece, _)| (self.ground.to_piece(point, piece.ends), piece.tile));
        near.fold((f64::INFINITY, (0, 0)), |least, piece| if piece.0 < least.0 { piece } else { least })
    }

    /// The largest distances in square `(x, y)` of `group` intervals, drawn at spacing `s`: of
    /// misdrawn points; with limits of them; of both, from the outline within the leaf tile.
    fn farthest(&self, s: usize, group: usize, (x, y): (usize, usize)) -> [f64; 3] {
        let across = self.parts * self.side + 1;
        let [mut truth, mut limits, mut of_tile] = [0.0_f64; 3];
        for j in self.parts * y * group..=self.parts * (y + 1) * group {
            for i in self.parts * x * group..=self.parts * (x + 1) * group {
                let (full, distance, _) = self.points[j * across + i];
                let at = self.part(j * across + i, across);
                let drawn = self.validity(s, at.0, at.1);
                if (full >= 0.5) != (drawn >= 0.5) {
                    truth = truth.max(distance);
                }
                if limit(full, drawn) {
                    limits = limits.max(distance);
                    let is_known = s > self.tile;
                    of_tile =
                        of_tile.max(if is_known { distance } else { self.in_tiles(group, (x, y), (i, j)) });
                }
            }
        }
        [truth, limits, of_tile]
    }

    /// The distance of point `(i, j)` from the outline within its leaf tile: of the tiles that it
    /// is in with a part of square `(x, y)` of `group` intervals, the one that is farthest from its
    /// own.
    fn in_tiles(&self, group: usize, (x, y): (usize, usize), (i, j): (usize, usize)) -> f64 {
        let (own, tiles) = (self.parts * self.tile, self.side / self.tile);
        let range = |place: usize, i: usize| {
            let first = place * group / self.tile;
            let end = ((place + 1) * group / self.tile).max(first + 1);
            (first..end).filter(move |tile| (tile * own..=(tile + 1) * own).contains(&i))
        };
        let within = range(y, j).flat_map(|v| range(x, i).map(move |u| (u, v)));
        let distances =
            within.map(|(u, v)| self.of_tiles[v * tiles + u][(j - v * own) * (own + 1) + i - u * own]);
        distances.fold(0.0, f64::max)
    }

    /// The smallest monotone tables of a level, patch by patch, step by step, of the distances and
    /// of those within leaf tiles: from what its own spacings give and the tables of the next finer
    /// level.
    fn smallest(own: &[Vec<[f64; 3]>], finer: &[Vec<[f64; 2]>], all: usize) -> Vec<Vec<[f64; 2]>> {
        let of_patch = |(at, own): (usize, &Vec<[f64; 3]>)| {
            let (x, y) = (at % all, at / all);
            let children = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| (2 * y + j) * 2 * all + 2 * x + i);
            let mut before = [0.0; 2];
            let steps = own.iter().enumerate().map(|(k, &[_, limits, of_tile])| {
                let of_children =
                    children.into_iter().filter_map(|child| finer.get(child).and_then(|c| c.get(k + 1)));
                let larger = |a: [f64; 2], b: &[f64; 2]| [a[0].max(b[0]), a[1].max(b[1])];
                before = of_children.fold(larger(before, &[limits, of_tile]), larger);
                before
            });
            steps.collect()
        };
        own.iter().enumerate().map(of_patch).collect()
    }

    /// Every stored error.
    pub fn ratios(&self, reader: &Reader) -> Vec<Ratio> {
        let header = reader.header();
        let (patches, steps) = (header.patches() as usize, header.steps() as usize);
        let mut out: Vec<Ratio> = Vec::new();
        // From the leaves up: the smallest tables of the finer level.
        let mut finer: Vec<Vec<[f64; 2]>> = Vec::new();
        for level in (0..=header.levels).rev() {
            let spacing = header.spacing(level) as usize;
            let (group, all) = (spacing * header.patch() as usize, patches << level);
            let truths = (0..all * all).map(|at| {
                let at = (at % all, at / all);
                (0..steps).map(|k| self.farthest(spacing << k, group, at)).collect()
            });
            let truths: Vec<Vec<[f64; 3]>> = truths.collect();
            let own = Self::smallest(&truths, &finer, all);
            for id in reader.tiles(level).expect("tiles") {
                let table = reader.read_errors(id).expect("errors");
                for (i, k) in (0..patches * patches).flat_map(|i| (0..steps).map(move |k| (i, k))) {
                    let (x, y) =
                        (id.x as usize * patches + i % patches, id.y as usize * patches + i / patches);
                    let within = (x + 1) * group < self.size.0 && (y + 1) * group < self.size.1;
                    let [least, of_tile] = own[y * all + x][k];
                    out.push(Ratio {
                        id,
                        patch: (i % patches, i / patches),
                        step: k,
                        stored: metres_from_code(table.horizontal[k * patches * patches + i]).into(),
                        truth: truths[y * all + x][k][0],
                        least,
                        of_tile,
                        at_edge: !within,
                    });
                }
            }
            finer = own;
        }
        out
    }
}

/// True if a point is misdrawn, or a limit of such points.
fn limit(full: f64, drawn: f64) -> bool {
    full <= 0.5 && drawn >= 0.5 || full >= 0.5 && drawn <= 0.5
}
