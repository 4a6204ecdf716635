//! Published patches: the tea set from the folder of reference models, in Newell's format and as free-form OBJ.

use std::path::PathBuf;

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

/// The lid's knob begins in a point on the axis, where its four patches have one normal.
#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn the_tip_of_the_lid_is_a_pole() {
    for patch in 20..24 {
        let surface = Surface::from(patch_from_bytes(&shared("teapot"), Some(patch)).unwrap());
        assert_eq!(surface.poles(), [false; 4], "{patch}");
    }
    for patch in 16..20 {
        let surface = Surface::from(patch_from_bytes(&shared("teapot"), Some(patch)).unwrap());
        assert_eq!(surface.poles(), [false, false, true, false], "{patch}");
        let normal = surface.normal(0.3, 0.0).map(|normal| normal.z.abs());
        assert!(normal.is_none_or(|z| z > 1.0 - 1e-9), "{normal:?}");
    }
}
