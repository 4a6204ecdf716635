//! The tolerances of the library, each relative to a stated scale. Elsewhere a tolerance is a parameter.

/// A vertex this far outside a lattice still counts as inside; relative to the longest edge of the lattice frame. Larger:
/// vertices that truly stick out are moved by the linear extension; smaller: vertices on the border of a lattice that was
/// fitted to rounded bounds are left behind and the model tears.
pub const INSIDE: f64 = 1e-9;

/// A model whose |volume| is below this fraction of area · extent encloses nothing. Larger: thin sheets are refused;
/// smaller: rounding noise of an open or doubled surface is taken for a volume.
pub const NO_VOLUME: f64 = 1e-9;

/// An axis is dead where `Σ m α² ≤ (DEAD_AXIS · Σ |∂V/∂p|)² max m`, the sum over the vertices: volume hardly depends on it. Larger: weak axes are given up
/// that could still work; smaller: control points run away.
pub const DEAD_AXIS: f64 = 1e-12;

/// An axis is weak where `Σ m α² ≤ (WEAK_AXIS · V / extent)² max m`: it would take moves of 1/WEAK_AXIS extents to change the
/// volume V by itself. Weak axes give their share to others, if there are others. Larger: axes are spared that the user
/// asked for; smaller: symmetric models whose coordinates were rounded to 32 bits send controls 10⁷ extents away.
pub const WEAK_AXIS: f64 = 1e-6;

/// Relative volume error that a correction must reach. Ordinary models reach it with a margin of 100 to 1000. Larger: exact
/// would not mean exact; smaller: thin models are refused whose coordinates cannot do better.
pub const VOLUME: f64 = 1e-13;

/// Below this relative volume error a search may let it grow again, up to this. Larger: steps that lead away; smaller: rounding stops a search
/// that has not come to the smallest displacement.
pub const NEAR_VOLUME: f64 = 1e-6;

/// Below this relative volume error no further correction step is tried: a few roundings of the volume itself.
pub const VOLUME_ROUNDING: f64 = 4.0 * f64::EPSILON;

/// A point's row whose part that is independent of the other points' is below this fraction of it counts as dependent. Larger:
/// points close together are taken for one; smaller: they pull controls apart without bound.
pub const DEPENDENT_ROW: f64 = 1e-10;

/// Points must come to their targets within this fraction of the extent. Larger: exact would not mean exact; smaller: rounding
/// is taken for a contradiction.
pub const POINT: f64 = 1e-12;

/// The nearest correction stops where `‖δ − μ M ∘ ∇V‖∞` is below this fraction of the extent. Larger: the displacement is longer
/// than it need be; smaller: rounding is chased.
pub const KKT: f64 = 1e-12;

/// What the nearest correction must reach to be called so. Larger: nearest would not mean nearest; smaller: thin models, whose
/// gradients are rounded, fail.
pub const KKT_ENOUGH: f64 = 1e-10;

/// Springs have settled where what pushes a node is below this fraction of the force that stretches a spring by its own length. Larger: nodes
/// are further from where they settle than need be; smaller: rounding is chased.
pub const BALANCE: f64 = 1e-12;

/// What forces must come to, to be called balanced. Larger: settled would not mean settled; smaller: large meshes, whose gradients are
/// rounded, fail.
pub const BALANCE_ENOUGH: f64 = 1e-9;

/// What is added to the diagonal of an energy of the lattice, whose mean diagonal is 1. Larger: the smallest displacement is that of the controls rather
/// than of the energy; smaller: what the energy does not feel moves far for little.
pub const ENERGY_FLOOR: f64 = 1e-6;

/// The same for the energy of the surface, which hardly feels controls that few vertices follow. Larger: it is the displacement of the
/// controls that is kept small; smaller: such controls run far away, for little. For a change of 0.4 % three models moved controls of
/// a lattice of 10³ by up to 0.19 extents with 1e-6, 0.04 with 1e-4 and 0.007 with this, and their vertices by as much in the
/// mean with all of them.
pub const SURFACE_FLOOR: f64 = 1e-2;

/// A winding number counts where it is within this distance of a whole number. Larger: a point on a sharp corner passes for one
/// outside; smaller: the rounding of a sum over millions of triangles makes clear answers unclear.
pub const WINDING: f64 = 1e-6;

/// A point inside a cage has Green coordinates without a continuation where its winding number is within this of 1. Larger: they sum to 1 less exactly;
/// smaller: the rounding of a sum over thousands of triangles makes points look for the closest one.
pub const WHOLE_WINDING: f64 = 1e-13;

/// A triangle touches a point where sine and cosine of half its solid angle, over the product of the distances of its corners,
/// say so to this precision. Larger: points near a surface say nothing; smaller: the rounding of a point on the surface
/// decides on which side it is.
pub const TOUCHES: f64 = 1e-9;

/// So many clear answers decide whether one component lies inside another. Larger: it takes longer; smaller: one triangle
/// that sticks out decides.
pub const CLEAR_ANSWERS: usize = 3;

/// A part of the body that lacks less than this fraction of its rest volume has lost nothing. Larger: small losses get no
/// correction of their own; smaller: what only turned counts as lost by the rounding of its determinant.
pub const NO_LOSS: f64 = 1e-12;

/// A lattice frame whose volume is below this fraction of the product of its edge lengths is degenerate. Larger: strongly
/// sheared frames are refused; smaller: parameters lose all their digits.
pub const FLAT_FRAME: f64 = 1e-9;

/// A side of the model's box below this fraction of its extent is widened before a lattice is fitted. Larger: thin plates
/// get a lattice that is thicker than they are; smaller: parameters along the side are noise.
pub const FLAT_SIDE: f64 = 1e-12;

/// A simplified component's volume is within this fraction of the fine one's. Larger: the volume's gradient points elsewhere;
/// smaller: small components, and those that hardly enclose anything, are not simplified.
pub const COARSE_VOLUME: f64 = 0.1;

/// A model is only accepted with an extent between these: beyond, products of three coordinates leave the range in which
/// f64 keeps its full precision.
pub const EXTENTS: std::ops::RangeInclusive<f64> = 1e-70..=1e90;

/// Points of a surface that are nearer to each other than this fraction of its extent are one: its borders meet in a seam, or a border is a
/// pole. Larger: narrow gaps are closed; smaller: the rounding of control points opens seams.
pub const SEAM: f64 = 1e-12;

/// A surface has a normal at a pole where the normals towards it differ by less than this. Larger: the tips of blunt cones get normals;
/// smaller: rounding takes those of smooth poles.
pub const POLE: f64 = 1e-9;

/// A surface whose `|S_s × S_t|` is below this fraction of `max(|S_s|, |S_t|)` · extent everywhere has no area. Larger: thin strips are refused;
/// smaller: rounding passes for a width.
pub const FLAT_SURFACE: f64 = 1e-12;

/// A point so near a cage, relative to its extent, is on it. Larger: points beside it are moved onto it; smaller: angles of sides seen end to end
/// are noise.
pub const ON_CAGE: f64 = 1e-14;

/// Cages are warned of whose Lebesgue constant is larger. More: corrections throw vertices far away without a word; less: good cages are warned of.
pub const LEBESGUE_CONSTANT: f64 = 20.0;

/// Derivatives at points nearer to a cage than this, relative to its extent, are taken this far inside: on it they have no value. Larger: they are
/// those of another place; smaller: digits are lost.
pub const BESIDE_CAGE: f64 = 1e-6;
