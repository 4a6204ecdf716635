//! Lists of a fixed length in job files.
//!
//! The readers of arrays that serde and glam bring leave it to the file format to object to surplus entries, and TOML's does
//! not: `by = [0, 0, 1, 5]` would pass for `[0, 0, 1]`. These read exactly as many as there must be.

use std::fmt;
use std::marker::PhantomData;

use glam::DVec3;
use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

/// Exactly N values.
pub(crate) struct Exact<T, const N: usize>(pub [T; N]);

impl<'de, T: Deserialize<'de>, const N: usize> Deserialize<'de> for Exact<T, N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct ExactVisitor<T, const N: usize>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for ExactVisitor<T, N> {
            type Value = Exact<T, N>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                write!(f, "a list of {N}")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Exact<T, N>, A::Error> {
                let mut values = Vec::with_capacity(N);
                while values.len() < N
                    && let Some(value) = list.next_element()?
                {
                    values.push(value);
                }
                let mut found = values.len();
                while list.next_element::<IgnoredAny>()?.is_some() {
                    found += 1;
                }
                match <[T; N]>::try_from(values) {
                    Ok(values) if found == N => Ok(Exact(values)),
                    _ => Err(A::Error::invalid_length(found, &self)),
                }
            }
        }
        deserializer.deserialize_seq(ExactVisitor(PhantomData))
    }
}

impl From<Exact<f64, 3>> for DVec3 {
    fn from(Exact(coordinates): Exact<f64, 3>) -> Self {
        Self::from_array(coordinates)
    }
}

/// For `deserialize_with`: N values.
pub(crate) fn array<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    from: D,
) -> Result<[T; N], D::Error> {
    Exact::deserialize(from).map(|Exact(values)| values)
}

/// For `deserialize_with`: N values or none; with `default`.
pub(crate) fn optional_array<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    from: D,
) -> Result<Option<[T; N]>, D::Error> {
    Option::deserialize(from).map(|values| values.map(|Exact(values)| values))
}

/// For `deserialize_with`: [x, y, z].
pub(crate) fn vector<'de, D: Deserializer<'de>>(from: D) -> Result<DVec3, D::Error> {
    array(from).map(DVec3::from_array)
}

/// For `deserialize_with`: [x, y, z] or nothing; with `default`.
pub(crate) fn optional_vector<'de, D: Deserializer<'de>>(from: D) -> Result<Option<DVec3>, D::Error> {
    Ok(optional_array(from)?.map(DVec3::from_array))
}

/// For `deserialize_with`: N vectors [x, y, z] or none; with `default`.
pub(crate) fn optional_vectors<'de, D: Deserializer<'de>, const N: usize>(
    from: D,
) -> Result<Option<[DVec3; N]>, D::Error> {
    let rows: Option<[Exact<f64, 3>; N]> = optional_array(from)?;
    Ok(rows.map(|rows| rows.map(DVec3::from)))
}

/// For `deserialize_with`: rows of vectors [x, y, z], of any lengths, or none; with `default`.
pub(crate) fn optional_rows<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<Vec<DVec3>>>, D::Error> {
    let rows: Option<Vec<Vec<Exact<f64, 3>>>> = Option::deserialize(from)?;
    Ok(rows.map(|rows| rows.into_iter().map(|row| row.into_iter().map(DVec3::from).collect()).collect()))
}

/// For `deserialize_with`: vectors [x, y, z].
pub(crate) fn list<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<DVec3>, D::Error> {
    Ok(Vec::<Exact<f64, 3>>::deserialize(from)?.into_iter().map(DVec3::from).collect())
}
