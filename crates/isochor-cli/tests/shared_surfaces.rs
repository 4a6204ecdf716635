//! Published patches: the tea set from the folder of reference models, in Newell's format and as free-form OBJ.

use std::path::PathBuf;

use glam::DVec3;
use isochor::Surface;
use isochor_io::{patch_from_bytes, patches_from_bytes};

fn shared(path: &str) -> Vec<u8> {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    std::fs::read(PathBuf::from(folder).join("models/nurbs").join(path)).unwrap()
}

/// The numbers of patches stand in the first lines of the files.
#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn the_tea_set() {
    for (name, count) in [("teapot", 32), ("teacup", 26), ("teaspoon", 16)] {
        let patches = patches_from_bytes(&shared(name)).unwrap();
        assert_eq!(patches.len(), count, "{name}");
        for patch in patches {
            let surface = Surface::from(patch);
            assert!(surface.jet_and_normal(0.4, 0.6).1.is_some());
            assert!(!surface.mesh([4, 4]).unwrap().faces().is_empty());
        }
    }
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn the_teapot_is_the_same_in_both_formats() {
    let [newell, obj] =
        ["teapot", "teapot-freeform-derived.obj"].map(|name| patches_from_bytes(&shared(name)).unwrap());
    assert_eq!(newell, obj);
    assert_eq!(patch_from_bytes(&shared("teapot"), Some(31)).unwrap(), obj[31]);
}

/// Patches 20 to 23, the knob of the lid, begin in one point, where all of them lie level: the next control points have its z.
/// So do 28 to 31, the bottom, which faces downwards. The others have no poles.
#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn the_knob_and_the_bottom_of_the_teapot_are_poles() {
    for (number, patch) in patches_from_bytes(&shared("teapot")).unwrap().into_iter().enumerate() {
        let surface = Surface::from(patch);
        let normal = match number {
            20..24 => Some(DVec3::Z),
            28..32 => Some(-DVec3::Z),
            _ => None,
        };
        assert_eq!(surface.poles(), [false, false, normal.is_some(), false], "{number}");
        if let Some(normal) = normal {
            let found = surface.normal(0.3, 0.0).unwrap();
            assert!(found.distance(normal) < 1e-12, "{number}: {found}");
        }
    }
}
