//! Saved bindings: back to the bit, and no damage goes unnoticed.

use glam::DVec3;
use isochor::{Faces, Mesh};
use isochor_io::{Place, ReadError, SavedBinding, hash_of_cage, hash_of_points};
use proptest::prelude::*;

const HEAD: usize = 128;
const HASH: usize = 32;

/// Four points, of which the second and the last have no weights, and one that has −0.
fn small() -> SavedBinding {
    SavedBinding {
        coordinates: "mean-value".into(),
        settings: "{\"é\":1}".into(),
        model: std::array::from_fn(|k| k as u8),
        cage: std::array::from_fn(|k| 100 + k as u8),
        points: 4,
        columns: 2,
        weights: vec![0.25, 0.75, 0.0, 0.0, 0.0, -0.0, 0.0, 0.0],
    }
}

fn bits(weights: &[f64]) -> Vec<u64> {
    weights.iter().map(|w| w.to_bits()).collect()
}

/// What stands before the checksum, with the right one behind.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.extend_from_slice(blake3::hash(&bytes).as_bytes());
    bytes
}

/// The file of [`small`] after a change, with the right checksum.
fn changed(change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = small().to_bytes();
    bytes.truncate(bytes.len() - HASH);
    change(&mut bytes);
    sealed(bytes)
}

fn refusal(bytes: &[u8]) -> ReadError {
    let error = SavedBinding::from_bytes(bytes).unwrap_err();
    assert!(error.place().is_some() && error.hint().is_some(), "{error}");
    error
}

fn refused(bytes: &[u8], byte: usize, words: &str) {
    let error = refusal(bytes);
    assert_eq!(error.place(), Some(Place::Byte(byte)), "{error}");
    assert!(error.to_string().contains(words), "{error}");
}

#[test]
fn the_file_is_laid_out_as_the_docs_say() {
    let mut want = b"isochor binding\n".to_vec();
    for number in [1_u64, 10, 8, 4, 2, 2] {
        want.extend_from_slice(&number.to_le_bytes());
    }
    want.extend((0..32).chain(100..132));
    want.extend_from_slice("mean-value{\"é\":1}".as_bytes());
    want.push(0b0101);
    for weight in [0.25, 0.75, 0.0, -0.0_f64] {
        want.extend_from_slice(&weight.to_le_bytes());
    }
    let bytes = small().to_bytes();
    assert_eq!(bytes, sealed(want));
    let again = SavedBinding::from_bytes(&bytes).unwrap();
    assert_eq!((&again, bits(&again.weights)), (&small(), bits(&small().weights)));
}

#[test]
fn every_flipped_bit_is_found() {
    let bytes = small().to_bytes();
    for bit in 0..8 * bytes.len() {
        let mut bytes = bytes.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        refusal(&bytes);
    }
}

#[test]
fn files_that_are_cut_or_longer_are_found() {
    let bytes = small().to_bytes();
    for length in 0..bytes.len() {
        refusal(&bytes[..length]);
    }
    refused(&bytes[..40], 40, "the file has 40 bytes, but should have 160");
    refused(&bytes[..bytes.len() - 1], bytes.len() - 1, "it is cut");
    refused(&[&bytes[..], b"\n"].concat(), bytes.len(), "but should have");
}

#[test]
fn other_files_and_versions_are_named() {
    refused(b"", 0, "no saved binding");
    refused(b"ply\nformat ascii 1.0\n", 0, "no saved binding");
    refused(&changed(|bytes| bytes[16] = 2), 16, "written by a newer version: the format is 2, and 1 can be read");
    refused(&changed(|bytes| bytes[16] = 0), 16, "the format is 0");
}

/// Each with the right checksum: nothing is taken at its word.
#[test]
fn lies_about_sizes_are_found() {
    let with = |at: usize, number: u64| changed(|bytes| bytes[at..at + 8].copy_from_slice(&number.to_le_bytes()));
    let size = small().to_bytes().len();
    for at in [24, 32, 40, 48, 56] {
        refusal(&with(at, 0));
        refusal(&with(at, u64::MAX));
        refusal(&with(at, 1 << 61));
        refusal(&with(at, 1 << 40));
    }
    refused(&with(24, u64::MAX), 24, "more bytes than can be counted");
    refused(&with(24, 11), size, "it is cut");
    refused(&with(24, 9), size - 1, "but should have");
    // Columns that no byte of the file stands for.
    let empty = SavedBinding { weights: vec![0.0; 8], ..small() };
    let mut bytes = empty.to_bytes();
    bytes.truncate(bytes.len() - HASH);
    bytes[48..56].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    refused(&sealed(bytes), 40, "4 × 1152921504606846976 weights do not fit into memory");
    // Two lengths of texts that add up all the same, in the middle of a letter.
    let moved = changed(|bytes| (bytes[24], bytes[32]) = (13, 5));
    refused(&moved, HEAD + 12, "not UTF-8");
}

#[test]
fn masks_and_weights_that_cannot_be_are_found() {
    let mask = HEAD + 18;
    refused(&changed(|bytes| bytes[mask] = 0b0111), mask, "3 bits are set for 2 rows of 4 points");
    refused(&changed(|bytes| bytes[mask] = 0b10001), mask, "2 bits are set");
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let bytes = changed(|bytes| bytes[mask + 17..mask + 25].copy_from_slice(&bad.to_le_bytes()));
        refused(&bytes, mask + 17, "a weight of point 2 is not a finite number");
    }
}

#[test]
fn rows_without_weights_take_no_room() {
    let all = SavedBinding { points: 1000, columns: 50, weights: vec![0.0; 50_000], ..small() };
    assert_eq!(all.to_bytes().len(), HEAD + 18 + 125 + HASH);
    assert_eq!(SavedBinding::from_bytes(&all.to_bytes()).unwrap(), all);
}

#[test]
fn hashes_tell_models_and_cages_apart() {
    // The hash of nothing is that of the test vectors of BLAKE3.
    let nothing: String = hash_of_points(&[]).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(nothing, "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262");
    let points: Vec<DVec3> = (0..5000).map(|k| DVec3::new(f64::from(k), 0.1, -1.0 / 3.0)).collect();
    let bytes: Vec<u8> = points.iter().flat_map(|p| p.to_array()).flat_map(f64::to_le_bytes).collect();
    assert_eq!(&hash_of_points(&points), blake3::hash(&bytes).as_bytes());

    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let cage = |points: &[DVec3], faces: &[&[u32]]| {
        let faces: Faces = faces.iter().copied().collect();
        hash_of_cage(&Mesh::new(points.to_vec(), faces).unwrap())
    };
    let faces: [&[u32]; 2] = [&[0, 1, 2], &[0, 1, 2, 3]];
    let mut moved = corners;
    moved[1].y = 5e-324;
    let mut signed = corners;
    signed[2].x = -0.0;
    let all = [
        cage(&corners, &faces),
        cage(&moved, &faces),
        cage(&signed, &faces),
        cage(&corners, &[&[1, 2, 0], faces[1]]),
        cage(&corners, &[&[0, 1, 2, 0], &[1, 2, 3]]),
        cage(&corners, &faces[..1]),
        cage(&corners[..3], &faces[..1]),
    ];
    for (k, hash) in all.iter().enumerate() {
        assert!(!all[..k].contains(hash), "{k}");
    }
    assert_eq!(all[0], cage(&corners, &faces));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn any_binding_comes_back_to_the_bit(
        (points, columns) in (0..40_usize, 0..5_usize),
        kept in prop::collection::vec(any::<bool>(), 40),
        numbers in prop::collection::vec(any::<u64>(), 200),
        (coordinates, settings) in (".{0,12}", ".{0,40}"),
        (model, cage) in any::<([u8; 32], [u8; 32])>(),
    ) {
        // Bits of infinities and of what is no number are those of a smaller exponent here.
        let finite = |bits: u64| if f64::from_bits(bits).is_finite() { bits } else { bits & !(1 << 62) };
        let weight = |v: usize, c: usize| if kept[v] { f64::from_bits(finite(numbers[5 * v + c])) } else { 0.0 };
        let weights: Vec<f64> = (0..points).flat_map(|v| (0..columns).map(move |c| (v, c))).map(|(v, c)| weight(v, c)).collect();
        let binding = SavedBinding { coordinates, settings, model, cage, points, columns, weights };
        let again = SavedBinding::from_bytes(&binding.to_bytes()).unwrap();
        prop_assert_eq!(bits(&again.weights), bits(&binding.weights));
        prop_assert_eq!(again, binding);
    }
}
