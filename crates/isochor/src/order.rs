//! Stable orders by small whole keys, in linear time (counting sort).

/// The indices of `keys` in ascending order of their keys, each less than `bound`. Equal keys keep their order.
pub(crate) fn ascending(keys: &[u32], bound: usize) -> Vec<u32> {
    grouped(keys, bound).0
}

/// [`ascending`], and where in it the indices of each key end (#bound).
pub(crate) fn grouped(keys: &[u32], bound: usize) -> (Vec<u32>, Vec<u32>) {
    let mut next = vec![0u32; bound + 1];
    for &key in keys {
        next[key as usize + 1] += 1;
    }
    for k in 0..bound {
        next[k + 1] += next[k];
    }
    let mut order = vec![0; keys.len()];
    for (i, &key) in (0..).zip(keys) {
        let place = &mut next[key as usize];
        order[*place as usize] = i;
        *place += 1;
    }
    next.truncate(bound); // each key's place for one more is where it ends
    (order, next)
}

/// The place of each index in `order`.
pub(crate) fn places(order: &[u32]) -> Vec<u32> {
    let mut places = vec![0; order.len()];
    for (place, &i) in (0..).zip(order) {
        places[i as usize] = place;
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_keys_keep_their_order() {
        let order = ascending(&[2, 0, 2, 1, 0], 3);
        assert_eq!(order, [1, 4, 3, 0, 2]);
        assert_eq!(places(&order), [3, 0, 4, 2, 1]);
        assert!(ascending(&[], 0).is_empty());
    }

    #[test]
    fn groups_end_where_the_next_key_begins() {
        assert_eq!(grouped(&[2, 0, 2, 4, 0], 6).1, [2, 2, 4, 4, 5, 5]);
        assert_eq!(grouped(&[], 2).1, [0, 0]);
    }
}
