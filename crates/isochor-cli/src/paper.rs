//! Tables of the papers, for comparison.
//!
//! HB, tables 1 and 2: S. Hahmann, G.-P. Bonneau, S. Barbier, G. Elber, H. Hagen, *Volume-preserving FFD for programmable graphics
//! hardware*, The Visual Computer 28 (2012), section 7. Uniform cubic B-splines. The paper's "volume" is the time in which the displacement of the control
//! points along one axis is found for a pose: its volume, α by HB (10), and δ by HB (17); moving the vertices comes on top ("FFD").
//!
//! CO, table 1: B.-Y. Chen, Y. Ono, H. Johan, M. Ishii, T. Nishita, J. Feng, *3D model deformation along a parametric surface*, 2002,
//! section 4. Its figure 3, time of flattening against the number of grid cells, is a plot without numbers.
//!
//! CVB, table 3: M. À. Cerveró, Á. Vinacua, P. Brunet, *Volume-preserving deformation using generalized barycentric coordinates*, section 5.
//!
//! HML, tables 1 and 2: G. Hirota, R. Maheshwari, M. C. Lin, *Fast volume-preserving free form deformation using multi-level optimization*, Solid
//! Modeling 1999, section 5.2. Its figures 5 to 8, errors of nodes against time, are plots without numbers.

/// What HB computed on.
pub const MACHINE: &str = "Intel 2.13 GHz, NVIDIA GeForce 8800 GTS";

/// Control points along each side of the lattice in [`TABLE_2`], and in the first column of [`TABLE_1`].
pub const SIZE: usize = 10;

/// The same in the second column of [`TABLE_1`].
pub const SMALLER_SIZE: usize = 6;

/// A row of table 1: numbers other than 0 in the matrix B (#controls × #faces) of HB, section 6.2.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct NonZeros {
    pub model: &'static str,
    pub faces: usize,
    /// In a lattice of [`SIZE`]³ control points.
    pub in_10: usize,
    /// In one of [`SMALLER_SIZE`]³.
    pub in_6: usize,
}

/// A row of table 2: milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Times {
    pub model: &'static str,
    pub vertices: usize,
    /// Moving the vertices, on the GPU.
    pub gpu_ffd_ms: f64,
    /// Correcting the volume along one axis, on the processor.
    pub cpu_volume_ms: f64,
    /// The same on the GPU.
    pub gpu_volume_ms: f64,
}

const fn non_zeros(model: &'static str, faces: usize, in_10: usize, in_6: usize) -> NonZeros {
    NonZeros { model, faces, in_10, in_6 }
}

const fn times(model: &'static str, vertices: usize, [gpu_ffd_ms, cpu_volume_ms, gpu_volume_ms]: [f64; 3]) -> Times {
    Times { model, vertices, gpu_ffd_ms, cpu_volume_ms, gpu_volume_ms }
}

/// HB, table 1.
pub const TABLE_1: [NonZeros; 8] = [
    non_zeros("Sphere", 5120, 322_598, 301_916),
    non_zeros("Porsche", 10_474, 680_098, 635_637),
    non_zeros("Horse", 39_698, 2_306_680, 2_304_791),
    non_zeros("Bunny", 69_451, 4_026_316, 4_006_614),
    non_zeros("BallJoint", 274_120, 15_716_692, 15_649_260),
    non_zeros("HandSkel", 654_666, 37_662_714, 37_474_881),
    non_zeros("Dragon", 871_414, 49_929_232, 49_674_401),
    non_zeros("Happy", 1_087_716, 62_388_900, 62_479_049),
];

/// HB, table 2.
pub const TABLE_2: [Times; 8] = [
    times("Sphere", 2562, [0.02, 6.0, 10.0]),
    times("Porsche", 5247, [0.05, 12.0, 12.0]),
    times("Horse", 19_851, [0.23, 46.0, 16.0]),
    times("Bunny", 31_947, [0.34, 96.0, 19.0]),
    times("Armadillo", 52_971, [0.45, 154.0, 27.0]),
    times("BallJoint", 137_062, [1.84, 383.0, 59.0]),
    times("HandSkel", 327_323, [2.66, 749.0, 116.0]),
    times("Dragon", 437_645, [3.56, 1206.0, 156.0]),
];

/// A model of HB: its rows of the tables that have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    pub name: &'static str,
    pub non_zeros: Option<NonZeros>,
    pub times: Option<Times>,
}

/// All models of both tables, the smaller first.
pub fn models() -> Vec<Model> {
    let times = |name| TABLE_2.into_iter().find(|row| row.model == name);
    let of_table_1 = TABLE_1.map(|row| Model { name: row.model, non_zeros: Some(row), times: times(row.model) });
    let is_new = |row: &Times| TABLE_1.iter().all(|other| other.model != row.model);
    let of_table_2 = TABLE_2.into_iter().filter(is_new);
    let mut models: Vec<Model> = of_table_1.into();
    models.extend(of_table_2.map(|row| Model { name: row.model, non_zeros: None, times: Some(row) }));
    models.sort_by_key(Model::vertices);
    models
}

/// What CO computed on.
pub const SURFACE_MACHINE: &str = "Xeon 2 GHz";

/// Grid steps over which CO keeps lengths in [`SURFACES`]: its r.
pub const SURFACE_REACH: usize = 3;

/// A row of CO's table 1: milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SurfaceTimes {
    /// Where the surface and what lies on it are shown.
    pub figure: &'static str,
    /// Polygons of the model, before faces are divided; they stand in the text.
    pub polygons: usize,
    /// Grid cells along both directions.
    pub cells: usize,
    /// Flattening the surface.
    pub flatten_ms: f64,
    /// Deforming the model along it.
    pub deform_ms: f64,
}

/// CO, table 1: a thin plate along the first two surfaces, a dolphin along the last.
pub const SURFACES: [SurfaceTimes; 3] = [
    SurfaceTimes { figure: "Figure 8", polygons: 6, cells: 10, flatten_ms: 166.0, deform_ms: 12.0 },
    SurfaceTimes { figure: "Figure 9", polygons: 6, cells: 10, flatten_ms: 128.4, deform_ms: 16.0 },
    SurfaceTimes { figure: "Figure 10", polygons: 73_665, cells: 16, flatten_ms: 777.0, deform_ms: 186.2 },
];

/// What CVB computed on.
pub const CAGE_MACHINE: &str = "Intel Core2 Duo E8400, NVIDIA GTX280";

/// A row of CVB's table 3: milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct CageTimes {
    pub model: &'static str,
    pub vertices: usize,
    pub triangles: usize,
    /// The gradient with respect to one vertex of the cage, on the processor.
    pub gradient_ms: f64,
    /// Moving the vertices, on the GPU.
    pub gpu_deform_ms: f64,
    /// The same on the processor.
    pub cpu_deform_ms: f64,
}

const fn in_cage(model: &'static str, [vertices, triangles]: [usize; 2], times: [f64; 3]) -> CageTimes {
    let [gradient_ms, gpu_deform_ms, cpu_deform_ms] = times;
    CageTimes { model, vertices, triangles, gradient_ms, gpu_deform_ms, cpu_deform_ms }
}

/// CVB, table 3.
pub const CAGES: [CageTimes; 6] = [
    in_cage("Teapot", [530, 1024], [1.98, 0.18, 7.43]),
    in_cage("Semi-sphere", [2524, 1054], [2.03, 0.37, 3.38]),
    in_cage("Monkey", [2868, 968], [1.86, 0.19, 3.78]),
    in_cage("Bunny", [35_947, 69_451], [124.97, 0.81, 32.69]),
    in_cage("Cylinder", [303_504, 266_240], [369.79, 4.48, 272.58]),
    in_cage("Bust", [893_866, 1_782_976], [2303.58, 15.69, 830.95]),
];

/// CVB, section 4: the average absolute error of its polynomial for the angle of local stress, in degrees.
pub const STRESS_FIT_ERROR: f64 = 0.44;

/// What HML computed on.
pub const ELASTIC_MACHINE: &str = "SGI Onyx2, 195 MHz R10000";

/// A row of HML's table 1.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ElasticTimes {
    pub example: &'static str,
    /// T₁: milliseconds from the mesh alone.
    pub single_ms: f64,
    /// T₂: milliseconds from level to level.
    pub multi_ms: f64,
    /// T₁/T₂, as it stands there.
    pub ratio: f64,
    /// Of the mesh itself.
    pub triangles: usize,
    /// By how much the volume is off at the end, relatively.
    pub volume_error: f64,
}

/// A row of HML's table 2.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ElasticLevel {
    pub triangles: usize,
    /// ΔX: how far a coordinate of a node moved at most, in extents.
    pub change: f64,
    pub steps: usize,
    pub ms: f64,
    /// Up to the level's end.
    pub cumulated_ms: f64,
}

const fn elastic(
    example: &'static str,
    [single_ms, multi_ms, ratio]: [f64; 3],
    triangles: usize,
    volume_error: f64,
) -> ElasticTimes {
    ElasticTimes { example, single_ms, multi_ms, ratio, triangles, volume_error }
}

const fn level(triangles: usize, change: f64, steps: usize, [ms, cumulated_ms]: [f64; 2]) -> ElasticLevel {
    ElasticLevel { triangles, change, steps, ms, cumulated_ms }
}

/// HML, table 1. Its figures 5 to 8 show these, in the same order.
pub const ELASTIC_TIMES: [ElasticTimes; 4] = [
    elastic("Torus compression", [21_000.0, 1760.0, 12.0], 4096, 0.0005),
    elastic("Torus stretch", [677_400.0, 11_080.0, 61.0], 65_536, 0.0008),
    elastic("Club partial compression", [40_990.0, 3530.0, 12.0], 16_384, 0.0007),
    elastic("Cow bending", [15_810.0, 2240.0, 7.0], 5804, 0.0007),
];

/// HML, table 2: the levels of the first of these.
pub const ELASTIC_LEVELS: [ElasticLevel; 5] = [
    level(16, 0.25, 90, [120.0, 120.0]),
    level(64, 0.079, 15, [60.0, 180.0]),
    level(256, 0.033, 19, [290.0, 470.0]),
    level(1024, 0.004, 13, [700.0, 1170.0]),
    level(4096, 0.0001, 3, [590.0, 1760.0]),
];

impl Model {
    /// Vertices of a closed surface without handles that has as many triangles. An odd number, which no closed surface has, becomes the
    /// next larger one. Where the paper has no number of faces, it is the paper's number of vertices.
    pub fn vertices(&self) -> usize {
        let of_faces = self.non_zeros.map(|row| row.faces.div_ceil(2) + 2);
        of_faces.or(self.times.map(|row| row.vertices)).unwrap_or_default()
    }

    /// Triangles of that surface.
    pub fn faces(&self) -> usize {
        2 * self.vertices() - 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_have_the_faces_of_the_paper_where_a_closed_surface_can() {
        let models = models();
        assert_eq!(models.len(), 9);
        assert!(models.windows(2).all(|pair| pair[0].vertices() < pair[1].vertices()));
        for model in models {
            let expected = model.non_zeros.map_or(model.faces(), |row| row.faces);
            assert_eq!(model.faces() - expected, usize::from(model.name == "Bunny"), "{}", model.name);
        }
    }

    /// The file with the numbers of all papers, which was made by others.
    fn reference() -> serde_json::Value {
        let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
        let text = std::fs::read_to_string(format!("{folder}/reference/paper_tables.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    }

    #[test]
    #[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
    fn rows_of_surfaces_are_those_of_the_reference_file() {
        let table = &reference()["CO"]["table1_ms"];
        assert_eq!(table["machine"], format!("{SURFACE_MACHINE}; r = {SURFACE_REACH}"));
        let rows = table["rows"].as_array().unwrap();
        assert_eq!(rows.len(), SURFACES.len());
        for (row, expected) in SURFACES.iter().zip(rows) {
            let grid = format!("{0}x{0}", row.cells);
            assert_eq!((row.figure, &grid[..]), (expected[0].as_str().unwrap(), expected[1].as_str().unwrap()));
            let times = [row.flatten_ms, row.deform_ms];
            assert_eq!(times, [2, 3].map(|column| expected[column].as_f64().unwrap()), "{}", row.figure);
        }
    }

    #[test]
    #[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
    fn rows_of_elastic_lattices_are_those_of_the_reference_file() {
        let reference = &reference()["HML"];
        assert_eq!(reference["table1"]["machine"], ELASTIC_MACHINE);
        let expected = reference["table1"]["rows"].as_array().unwrap();
        assert_eq!(expected.len(), ELASTIC_TIMES.len());
        for (row, expected) in ELASTIC_TIMES.iter().zip(expected) {
            assert_eq!(
                (row.example, row.triangles as u64),
                (expected[0].as_str().unwrap(), expected[4].as_u64().unwrap())
            );
            let numbers = [row.single_ms, row.multi_ms, row.ratio, row.volume_error];
            assert_eq!(numbers, [1, 2, 3, 5].map(|column| expected[column].as_f64().unwrap()), "{}", row.example);
        }
        let expected = reference["table2_torus_compression"]["rows"].as_array().unwrap();
        assert_eq!(expected.len(), ELASTIC_LEVELS.len());
        for (k, (row, expected)) in ELASTIC_LEVELS.iter().zip(expected).enumerate() {
            let numbers = [k as f64, row.triangles as f64, row.change, row.steps as f64, row.ms, row.cumulated_ms];
            assert_eq!(numbers, [0, 1, 2, 3, 4, 5].map(|column| expected[column].as_f64().unwrap()), "level {k}");
        }
    }

    #[test]
    #[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
    fn rows_are_those_of_the_reference_file() {
        let reference = reference();
        let rows = |table: &str| reference["HB"][table]["rows"].as_array().unwrap().clone();
        let table_1 = rows("table1_nonzeros_of_B");
        assert_eq!(table_1.len(), TABLE_1.len());
        for (row, expected) in TABLE_1.iter().zip(&table_1) {
            assert_eq!(serde_json::json!([row.model, row.faces, row.in_10, row.in_6]), *expected);
        }
        let table_2 = rows("table2_ms");
        assert_eq!(table_2.len(), TABLE_2.len());
        for (row, expected) in TABLE_2.iter().zip(&table_2) {
            assert_eq!(
                (row.model, row.vertices),
                (expected[0].as_str().unwrap(), expected[1].as_u64().unwrap() as usize)
            );
            let times = [row.gpu_ffd_ms, row.cpu_volume_ms, row.gpu_volume_ms];
            assert_eq!(times, [2, 3, 4].map(|column| expected[column].as_f64().unwrap()), "{}", row.model);
            // The paper's last column.
            let factor = row.cpu_volume_ms / row.gpu_volume_ms;
            assert!((factor - expected[5].as_f64().unwrap()).abs() < 0.1, "{}: {factor}", row.model);
        }
    }
}
