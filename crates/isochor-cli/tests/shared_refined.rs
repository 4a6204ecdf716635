//! Real files with texture coordinates, normals, groups and materials, whose faces are split: the folder of reference models.

use std::path::PathBuf;

use glam::{DMat3, DVec3};
use isochor::{Mesh, Refinement};
use isochor_io::{Document, Format, WriteOptions};

fn read(path: &str) -> Document {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    let path = PathBuf::from(folder).join("models").join(path);
    Document::parse(std::fs::read(&path).unwrap(), Format::from_path(&path).unwrap()).unwrap()
}

/// Every third face split from the place of weights 1/2, 1/4, 1/4 between its first corners.
fn every_third_split(mesh: &Mesh) -> Refinement {
    let old = |k: usize| [(k as u32, 1.0), (0, 0.0), (0, 0.0)];
    let weights = [0.5, 0.25, 0.25];
    let mut all = Refinement::default();
    for (f, face) in mesh.faces().iter().enumerate() {
        let n = face.len();
        if f % 3 > 0 {
            all.faces.push(face);
            all.origins.push(f as u32);
            all.corners.extend((0..n).map(old));
            continue;
        }
        let vertex = (mesh.points().len() + all.vertices.len()) as u32;
        all.vertices.push([0, 1, 2].map(|k| (face[k], weights[k])));
        for k in 0..n {
            all.faces.push(&[face[k], face[(k + 1) % n], vertex]);
            all.origins.push(f as u32);
            all.corners.extend([old(k), old((k + 1) % n), [0, 1, 2].map(|k| (k as u32, weights[k]))]);
        }
    }
    all
}

fn mixed_points(mesh: &Mesh, refinement: &Refinement) -> Vec<DVec3> {
    let point = |parts: &[(u32, f64); 3]| parts.iter().map(|(v, w)| mesh.points()[*v as usize] * *w).sum();
    mesh.points().iter().copied().chain(refinement.vertices.iter().map(point)).collect()
}

/// A corner as it is read: texture coordinate and normal.
type Corner = [Option<Vec<f64>>; 2];

/// For each face of an OBJ text the statements in force (group, material, smoothing, object), and its corners.
fn painted_faces(text: &str) -> Vec<(Vec<String>, Vec<Corner>)> {
    let text = text.replace('\r', "").replace("\\\n", " ");
    let numbers = |keyword: &str| -> Vec<Vec<f64>> {
        let lines = text.lines().filter(|line| line.split_whitespace().next() == Some(keyword));
        lines.map(|line| line.split_whitespace().skip(1).map(|x| x.parse().unwrap()).collect()).collect()
    };
    let lines = [numbers("vt"), numbers("vn")];
    let (mut before, mut state, mut faces) = ([0; 2], vec![String::new(); 4], Vec::new());
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let Some((&keyword, rest)) = words.split_first() else { continue };
        match keyword {
            "vt" => before[0] += 1,
            "vn" => before[1] += 1,
            "f" => {
                let corner = |word: &&str| {
                    let mut fields = word.split('/').skip(1);
                    [0, 1].map(|kind| {
                        let index: i64 = fields.next().filter(|field| !field.is_empty())?.parse().unwrap();
                        let k = if index < 0 { before[kind] + index } else { index - 1 };
                        Some(lines[kind][k as usize].clone())
                    })
                };
                faces.push((state.clone(), rest.iter().map(corner).collect()));
            }
            _ => {
                if let Some(k) = ["g", "usemtl", "s", "o"].iter().position(|k| *k == keyword) {
                    state[k] = rest.join(" ");
                }
            }
        }
    }
    faces
}

fn mixed(corners: &[Corner], kind: usize, parts: &[(u32, f64); 3]) -> Option<DVec3> {
    let value = |(k, w): &(u32, f64)| {
        let numbers = corners[*k as usize][kind].as_ref()?;
        let axis = |n: usize| numbers.get(n).copied().unwrap_or_default();
        let v = DVec3::new(axis(0), axis(1), axis(2));
        Some(if kind == 1 { v.normalize() * *w } else { v * *w })
    };
    parts.iter().map(value).sum()
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn real_obj_files_keep_all_when_faces_are_split() {
    for file in [
        "formats/real/fuze.obj",
        "formats/real/cylinder-ngon.obj",
        "formats/real/wallhole.obj",
        "formats/made/ico162-vt-vn-groups.obj",
        "closed/spot-2928quads.obj",
        "cages/fish-control.obj",
    ] {
        let document = read(file);
        let refinement = every_third_split(document.mesh());
        let points = mixed_points(document.mesh(), &refinement);
        let jacobians = vec![DMat3::IDENTITY; points.len()];
        let options = WriteOptions { jacobians: Some(&jacobians), ..Default::default() };
        let written = document.refined(&points, &refinement, &options).unwrap();
        // Texture coordinates and faces take turns in that file.
        let early = written.warnings.iter().filter(|warning| warning.contains("name added lines behind them")).count();
        assert_eq!((written.warnings.len(), early), if file.ends_with("fuze.obj") { (1, 1) } else { (0, 0) }, "{file}");
        let again = Document::parse(written.bytes.clone(), Format::Obj).unwrap();
        assert!(again.mesh().points() == points && *again.mesh().faces() == refinement.faces, "{file}");

        let before = painted_faces(&String::from_utf8_lossy(document.bytes()));
        let after = painted_faces(&String::from_utf8_lossy(&written.bytes));
        assert_eq!(after.len(), refinement.faces.len(), "{file}");
        let mut parts = refinement.corners.iter();
        for ((state, corners), &origin) in after.iter().zip(&refinement.origins) {
            let (old_state, old_corners) = &before[origin as usize];
            assert_eq!(state, old_state, "{file}");
            for (corner, parts) in corners.iter().zip(&mut parts) {
                for kind in [0, 1] {
                    let found = mixed(std::slice::from_ref(corner), kind, &[(0, 1.0), (0, 0.0), (0, 0.0)]);
                    let want = mixed(old_corners, kind, parts);
                    // Normals in files have any length.
                    let [found, want] = [found, want].map(|v| if kind == 1 { v.map(DVec3::normalize) } else { v });
                    let agree = match (found, want) {
                        (Some(found), Some(want)) => (found - want).length() < 1e-12,
                        (found, want) => found == want,
                    };
                    assert!(agree, "{file}: {found:?} is not {want:?}");
                }
            }
        }
    }
}

/// Every PLY and STL file that can be read can be split, or says why not, and is read again as the mesh it should be.
#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn real_files_of_every_format_are_read_again_when_faces_are_split() {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    let (mut split, mut refused) = (0, Vec::new());
    for part in ["formats/real", "formats/made", "broken/made", "procedural"] {
        let mut files: Vec<_> =
            std::fs::read_dir(format!("{folder}/models/{part}")).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        for path in files {
            let Ok(format) = Format::from_path(&path) else { continue };
            let Ok(document) = Document::parse(std::fs::read(&path).unwrap(), format) else { continue };
            let refinement = every_third_split(document.mesh());
            let points = mixed_points(document.mesh(), &refinement);
            let written = match document.refined(&points, &refinement, &WriteOptions::default()) {
                Ok(written) => written,
                Err(error) => {
                    refused.push(format!("{}: {error}", path.display()));
                    continue;
                }
            };
            split += 1;
            let again =
                Document::parse(written.bytes, format).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            let place = |mesh: &Mesh, corner: &u32| mesh.points()[*corner as usize];
            let corners = again.mesh().faces().corners();
            assert_eq!(corners.len(), refinement.faces.corners().len(), "{}", path.display());
            let agree = |(a, b): (&u32, &u32)| place(again.mesh(), a) == written.points[*b as usize];
            assert!(corners.iter().zip(refinement.faces.corners()).all(agree), "{}", path.display());
        }
    }
    println!("{split} split, refused: {refused:#?}");
    let has_reason = |said: &String| {
        ["triangle strips", "an added one would take", "stored as an integer", "can hold"]
            .iter()
            .any(|r| said.contains(r))
    };
    assert!(split > 100 && refused.iter().all(has_reason), "{split}: {refused:#?}");
}
