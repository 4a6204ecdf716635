//! Saved bindings: the weights of a cage for the points of a model, in a compact binary file.
//!
//! Numbers are little-endian.
//!
//! | bytes | what |
//! |---|---|
//! | 16 | `isochor binding` and a line feed |
//! | 8 | version, 1 |
//! | 8, 8 | lengths in bytes of the name of the coordinates, and of the settings |
//! | 8, 8, 8 | numbers of points, of columns, and of kept rows |
//! | 32, 32 | BLAKE3 hashes of the model's points and of the cage |
//! | | name of the coordinates, and settings, UTF-8 |
//! | ⌈points/8⌉ | which rows are kept: bit `v % 8` of byte `v / 8` for point v |
//! | | the kept rows, columns × 8 bytes each: 64-bit floats |
//! | 32 | BLAKE3 hash of all bytes before |
//!
//! Rows whose weights are all +0 are left out: models often lie only partly in a cage.

use glam::DVec3;
use isochor::Mesh;

use crate::{Place, ReadError};

const MAGIC: &[u8; 16] = b"isochor binding\n";

/// The version that is written, and the only one that is read.
const VERSION: u64 = 1;

/// Bytes before the name of the coordinates.
const HEAD: usize = 128;

const HASH: usize = blake3::OUT_LEN;

/// Numbers that are hashed at once: larger makes no difference, smaller leaves wide instructions unused.
const HASHED: usize = 2048;

/// The weights of a cage, with what they belong to.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedBinding {
    /// Kind of coordinates, such as `mean-value`, `harmonic`, `green` or `tetrahedral`.
    pub coordinates: String,
    /// What else the weights depend on, such as a resolution: JSON, or nothing. It is kept as it is.
    pub settings: String,
    /// [`hash_of_points`] of the points at rest.
    pub model: [u8; 32],
    /// [`hash_of_cage`] of the cage at rest.
    pub cage: [u8; 32],
    /// Number of points.
    pub points: usize,
    /// Number of weights of a point.
    pub columns: usize,
    /// The weights, points × columns, row by row. Finite: a file with others is refused.
    pub weights: Vec<f64>,
}

/// Hash of the bits of `points` (#points × 3).
#[must_use]
pub fn hash_of_points(points: &[DVec3]) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    hash_points(&mut hasher, points);
    hasher.finalize().into()
}

/// Hash of the vertices of a cage, to the bit, and of its faces, corner for corner.
#[must_use]
pub fn hash_of_cage(mesh: &Mesh) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&(mesh.points().len() as u64).to_le_bytes());
    hash_points(&mut hasher, mesh.points());
    for face in mesh.faces().iter() {
        hasher.update(&(face.len() as u64).to_le_bytes());
        for corner in face {
            hasher.update(&corner.to_le_bytes());
        }
    }
    hasher.finalize().into()
}

fn hash_points(hasher: &mut blake3::Hasher, points: &[DVec3]) {
    let mut bytes = Vec::with_capacity(HASHED * 24);
    for points in points.chunks(HASHED) {
        bytes.clear();
        points.iter().for_each(|point| push_floats(&mut bytes, &point.to_array()));
        hasher.update(&bytes);
    }
}

fn push_floats(bytes: &mut Vec<u8>, floats: &[f64]) {
    bytes.extend(floats.iter().flat_map(|x| x.to_le_bytes()));
}

impl SavedBinding {
    /// The file.
    ///
    /// # Panics
    ///
    /// Panics where there are not `points` × `columns` weights.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let Self { points, columns, .. } = *self;
        assert_eq!(Some(self.weights.len()), points.checked_mul(columns), "a weight for each point and column");
        let rows = || (0..points).map(|v| &self.weights[v * columns..(v + 1) * columns]);
        let mut mask = vec![0_u8; points.div_ceil(8)];
        let mut kept = 0;
        for (v, _) in rows().enumerate().filter(|(_, row)| row.iter().any(|w| w.to_bits() != 0)) {
            mask[v / 8] |= 1 << (v % 8);
            kept += 1;
        }
        let texts = self.coordinates.len() + self.settings.len();
        let mut bytes = Vec::with_capacity(HEAD + texts + mask.len() + 8 * kept * columns + HASH);
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        for length in [self.coordinates.len(), self.settings.len(), points, columns, kept] {
            bytes.extend_from_slice(&(length as u64).to_le_bytes());
        }
        for part in [&self.model[..], &self.cage, self.coordinates.as_bytes(), self.settings.as_bytes(), &mask] {
            bytes.extend_from_slice(part);
        }
        rows().enumerate().filter(|(v, _)| is_set(&mask, *v)).for_each(|(_, row)| push_floats(&mut bytes, row));
        let hash = blake3::hash(&bytes);
        bytes.extend_from_slice(hash.as_bytes());
        bytes
    }

    /// Reads a file.
    ///
    /// # Errors
    ///
    /// No saved binding; one of another version; one that is cut, longer than it says or damaged in any byte; weights that are not finite, or
    /// more than fit into memory. The error tells the offset in bytes and what to do.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ReadError> {
        let Head { version, lengths } = Head::of(bytes)?;
        if version != VERSION {
            let error = if version > VERSION {
                ReadError::new(format!("written by a newer version: the format is {version}, and 1 can be read"))
                    .with_hint("use the newer version, or bind anew")
            } else {
                ReadError::new(format!("the format is {version}, and only 1 can be read")).with_hint(BIND_ANEW)
            };
            return Err(error.at(Place::Byte(MAGIC.len())));
        }
        let Layout { coordinates, settings, mask, rows } = Layout::of(&lengths, bytes.len())?;
        let end = bytes.len() - HASH;
        if blake3::hash(&bytes[..end]).as_bytes() != &bytes[end..] {
            let error = ReadError::new("the file is damaged: its checksum is another one");
            return Err(error.with_hint(BIND_ANEW).at(Place::Byte(end)));
        }
        let text = |from: usize, to: usize| {
            std::str::from_utf8(&bytes[from..to]).map(str::to_owned).map_err(|error| {
                let place = Place::Byte(from + error.valid_up_to());
                ReadError::new("text that is not UTF-8").with_hint(BIND_ANEW).at(place)
            })
        };
        let [_, _, points, columns, kept] = lengths.map(|length| usize::try_from(length).unwrap_or(usize::MAX));
        let bits = &bytes[mask..rows];
        let set: usize = bits.iter().map(|byte| byte.count_ones() as usize).sum();
        let is_beyond = (points..8 * bits.len()).any(|v| is_set(bits, v));
        if set != kept || is_beyond {
            let error = ReadError::new(format!("{set} bits are set for {kept} rows of {points} points"));
            return Err(error.with_hint(BIND_ANEW).at(Place::Byte(mask)));
        }
        Ok(Self {
            coordinates: text(coordinates, settings)?,
            settings: text(settings, mask)?,
            model: array(bytes, 64),
            cage: array(bytes, 96),
            points,
            columns,
            weights: weights(&bytes[..end], rows, bits, [points, columns])?,
        })
    }
}

/// What to do about a file that says nothing useful.
const BIND_ANEW: &str = "delete it and bind anew";

fn is_set(mask: &[u8], v: usize) -> bool {
    (mask[v / 8] >> (v % 8)) & 1 == 1
}

/// The N bytes at an offset, which are there.
fn array<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    std::array::from_fn(|k| bytes[at + k])
}

/// The version, and lengths of texts, numbers of points, columns and kept rows.
struct Head {
    version: u64,
    lengths: [u64; 5],
}

impl Head {
    fn of(bytes: &[u8]) -> Result<Self, ReadError> {
        if !bytes.starts_with(MAGIC) {
            let error = ReadError::new("this is no saved binding").at(Place::Byte(0));
            return Err(error.with_hint("a saved binding begins with 'isochor binding'"));
        }
        if bytes.len() < HEAD + HASH {
            return Err(cut(bytes.len(), (HEAD + HASH) as u64));
        }
        let number = |at: usize| u64::from_le_bytes(array(bytes, at));
        Ok(Self { version: number(16), lengths: [24, 32, 40, 48, 56].map(number) })
    }
}

fn cut(size: usize, due: u64) -> ReadError {
    ReadError::new(format!("the file has {size} bytes, but should have {due}: it is cut"))
        .with_hint(BIND_ANEW)
        .at(Place::Byte(size))
}

/// Where the parts behind the head begin.
struct Layout {
    coordinates: usize,
    settings: usize,
    mask: usize,
    rows: usize,
}

impl Layout {
    /// The parts of a file of so many bytes, if it can have them.
    fn of(&[coordinates, settings, points, columns, kept]: &[u64; 5], size: usize) -> Result<Self, ReadError> {
        let floats = kept.checked_mul(columns).and_then(|floats| floats.checked_mul(8));
        let parts = [Some(coordinates), Some(settings), Some(points.div_ceil(8)), floats, Some(HASH as u64)];
        let due = parts.into_iter().try_fold(HEAD as u64, |sum, part| sum.checked_add(part?));
        match due {
            Some(due) if due == size as u64 => {}
            Some(due) if due > size as u64 => return Err(cut(size, due)),
            Some(due) => {
                let error = ReadError::new(format!("the file has {size} bytes, but should have {due}"));
                return Err(error.with_hint(BIND_ANEW).at(Place::Byte(due as usize)));
            }
            None => {
                let error = ReadError::new("the file announces more bytes than can be counted");
                return Err(error.with_hint(BIND_ANEW).at(Place::Byte(24)));
            }
        }
        // All parts are within the file now.
        let first = HEAD + coordinates as usize;
        let mask = first + settings as usize;
        Ok(Self { coordinates: HEAD, settings: first, mask, rows: mask + points.div_ceil(8) as usize })
    }
}

/// The weights of all points: of those in the mask from offset `at` on, 0 else.
fn weights(bytes: &[u8], mut at: usize, mask: &[u8], [points, columns]: [usize; 2]) -> Result<Vec<f64>, ReadError> {
    let mut weights = Vec::new();
    let room = points.checked_mul(columns).map(|all| weights.try_reserve_exact(all));
    if !matches!(room, Some(Ok(()))) {
        let error = ReadError::new(format!("{points} × {columns} weights do not fit into memory"));
        return Err(error.with_hint("bind a smaller model, or with a smaller cage").at(Place::Byte(40)));
    }
    for v in 0..points {
        if !is_set(mask, v) {
            weights.resize(weights.len() + columns, 0.0);
            continue;
        }
        let row = &bytes[at..at + 8 * columns];
        let floats = row.as_chunks::<8>().0.iter().map(|float| f64::from_le_bytes(*float));
        if let Some(k) = floats.clone().position(|weight| !weight.is_finite()) {
            let error = ReadError::new(format!("a weight of point {v} is not a finite number"));
            return Err(error.with_hint(BIND_ANEW).at(Place::Byte(at + 8 * k)));
        }
        weights.extend(floats);
        at += row.len();
    }
    Ok(weights)
}
