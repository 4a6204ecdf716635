//! The command line as it was typed.

use std::path::PathBuf;

use clap::builder::styling::{AnsiColor, Styles};
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};

use isochor::BuiltIn;

use crate::failure::Failure;
use crate::terminal::Terminal;

/// Bend, twist, squash or sculpt a 3D model: its volume comes out exactly as wanted.
#[derive(Debug, Parser)]
#[command(name = "isochor", version, propagate_version = true, max_term_width = 110, styles = STYLES)]
#[command(after_help = shapes())]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    #[command(flatten)]
    pub output: OutputArgs,
}

const STYLES: Styles =
    Styles::styled().header(AnsiColor::Green.on_default().bold()).literal(AnsiColor::Cyan.on_default());

/// What can be named instead of a model's file.
fn shapes() -> String {
    let names: Vec<String> =
        BuiltIn::ALL.iter().map(|shape| format!("shape:{}?n={}", shape.name, shape.usual)).collect();
    let width = names.iter().map(String::len).max().unwrap_or_default();
    let mut text = String::from("Built-in shapes, for any MODEL; n, how finely they are divided, may be left out:\n");
    for (name, shape) in names.iter().zip(BuiltIn::ALL) {
        text += &format!("  {name:<width$}  {}\n", shape.about);
    }
    text
}

#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Output and threads")]
pub struct OutputArgs {
    /// Print one machine-readable JSON report on standard output, errors included.
    #[arg(long, global = true)]
    pub json: bool,
    /// Print nothing but errors on standard error.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Number of threads; results do not depend on it. All cores by default.
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Deform built-in shapes: models, jobs and a report that one can open and run again.
    #[command(after_help = "Examples:\n  isochor demo\n  isochor demo out && isochor deform --job out/ball.toml")]
    Demo {
        /// Folder to write to; made if missing.
        #[arg(default_value = "isochor-demo")]
        folder: PathBuf,
    },
    /// Health check: what a model is, its volumes, and whether they can be preserved.
    #[command(
        after_help = "Examples:\n  isochor info bunny.ply\n  isochor info --json bunny.ply\n  isochor info shape:cup"
    )]
    Info {
        /// The model: .obj, .ply, .stl or .off, or a built-in shape such as shape:ball.
        model: PathBuf,
    },
    /// Deform a model and keep its volume, from flags or from a job file.
    #[command(after_help = DEFORM_EXAMPLES)]
    Deform(Box<DeformArgs>),
    /// Make a cage round a model: a closed mesh of few triangles that holds it, to deform it by.
    #[command(after_help = CAGE_EXAMPLES)]
    Cage(CageArgs),
    /// Measure times and memory on this machine.
    #[command(
        after_help = "Examples:\n  isochor bench lattice\n  isochor bench surface\n  isochor bench elastic\n  isochor bench cage\n  isochor bench deform"
    )]
    Bench {
        #[command(subcommand)]
        bench: BenchCommand,
    },
    /// Print completions for a shell.
    #[command(
        after_help = "Examples:\n  isochor completions bash > ~/.local/share/bash-completion/completions/isochor"
    )]
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Print the manual page, or write one page per command into a folder.
    #[command(after_help = "Examples:\n  isochor man | man -l -\n  isochor man ~/.local/share/man/man1")]
    Man {
        /// Folder to write the pages to.
        folder: Option<PathBuf>,
    },
}

/// What can be measured.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// The tables of the paper about lattices, this machine beside them, with 1 and all threads; takes some minutes and 2 GB of memory.
    #[command(
        after_help = "Examples:\n  isochor bench lattice --plot performance.svg\n  isochor bench lattice --quick --json"
    )]
    Lattice(BenchLatticeArgs),
    /// The table of the paper about surfaces, this machine beside it, and its plot for this machine, with 1 and all threads; takes half a
    /// minute.
    #[command(
        after_help = "Examples:\n  isochor bench surface --plot flatten.svg\n  isochor bench surface --quick --json"
    )]
    Surface(BenchSurfaceArgs),
    /// The tables of the paper about elastic lattices, this machine beside them, and its plots for this machine; takes a minute.
    #[command(
        after_help = "Examples:\n  isochor bench elastic --plot convergence.svg\n  isochor bench elastic --quick --json"
    )]
    Elastic(BenchElasticArgs),
    /// The table of the paper about cages, this machine beside it, with 1 and all threads, and its figures of local stress; takes half a minute
    /// and 2 GB of memory.
    #[command(after_help = "Examples:\n  isochor bench cage --plot stress.svg\n  isochor bench cage --quick --json")]
    Cage(BenchCageArgs),
    /// Whole deformations of files of many sizes: times of all stages, and memory.
    #[command(
        after_help = "Examples:\n  isochor bench deform\n  isochor bench deform --vertices 25000000 --runs 1 --threads 2\n\n\
                      Models are written to the folder of temporary files, 80 bytes per vertex with the result, and removed."
    )]
    Deform(BenchDeformArgs),
}

#[derive(Debug, Args)]
pub struct BenchLatticeArgs {
    /// Only small models and few runs: seconds instead of minutes, and much noise.
    #[arg(long)]
    pub quick: bool,
    /// Draw times against vertices to an .svg file.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct BenchSurfaceArgs {
    /// Only small grids and few runs: a second instead of half a minute, and much noise.
    #[arg(long)]
    pub quick: bool,
    /// Draw times of flattening against grid cells to an .svg file.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct BenchCageArgs {
    /// Only small models and few runs: a second instead of half a minute, and much noise.
    #[arg(long)]
    pub quick: bool,
    /// Draw the angle of local stress, as the largest of many directions and as a polynomial, to an .svg file.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct BenchElasticArgs {
    /// Only few runs: seconds instead of a minute, and much noise.
    #[arg(long)]
    pub quick: bool,
    /// Draw how far nodes are from where they end, against time, to an .svg file.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
}

#[derive(Clone, Debug, Default, Args)]
pub struct BenchDeformArgs {
    /// Vertices of a model, about; any number of times. 2500 to a million by default.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..=25_000_000))]
    pub vertices: Vec<u32>,
    /// Runs on each model, of which the fastest is told.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=100))]
    pub runs: u8,
}

const CAGE_EXAMPLES: &str = "Examples:
  isochor cage bunny.ply -o bunny-cage.obj
  isochor cage horse.ply -o horse-cage.obj --faces 300 --distance 0.01
  isochor cage shape:ring -o ring-cage.ply --json

Open, crossing and flat models have cages, too.
Exit codes: 0 done; 1 the request cannot be met; 2 bad input or usage. Nothing is written on 1 or 2.";

#[derive(Clone, Debug, Args)]
pub struct CageArgs {
    /// The model: .obj, .ply or .stl, or a built-in shape such as shape:ball; isochor help lists them.
    pub model: PathBuf,
    /// Where the cage goes: .obj or .ply.
    #[arg(long, short, value_name = "FILE")]
    pub output: PathBuf,
    /// At most so many triangles.
    #[arg(long, value_name = "N", default_value_t = 200)]
    pub faces: u32,
    /// Least distance of the model's vertices from the cage, as a fraction of the longest side of the model's box.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.02, allow_negative_numbers = true)]
    pub distance: f64,
}

const DEFORM_EXAMPLES: &str = "Examples:
  isochor deform bunny.ply -o twisted.ply --twist z=90
  isochor deform shape:ball -o flat.obj --stretch z=0.4 --preserve xy
  isochor deform tank.stl -o larger.stl --lattice 8x8x4 --volume 110% --pin k=0
  isochor deform horse.ply -o bent.ply --bend x=60,z --save-controls bent.json --report bent-report.json
  isochor deform spot.obj -o spot-twisted.obj --twist y=60 --picture spot.png --up y --report spot.html
  isochor deform horse.ply -o posed.ply --cage horse-cage.obj:free={vertices=[1,2]} --move v=7:0,0.2,0 --objective stress
  isochor deform shape:plate?n=1 -o arch.obj --surface cylinder:radius=0.5,height=2 --grid 24 --picture arch.png
  isochor deform --job twist.toml --lattice 10

Edits act on the control points of the lattice in the order in which they are typed, after those of a job file.
Exit codes: 0 done; 1 the request cannot be met; 2 bad input or usage. Nothing is written on 1 or 2.";

#[derive(Clone, Debug, Default, Args)]
pub struct DeformArgs {
    /// The model: .obj, .ply, .stl or .off, or a built-in shape such as shape:ball; isochor help lists them.
    pub model: Option<PathBuf>,
    /// Where the result goes; the same format keeps everything else in the file.
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Read the request from a job file (.toml or .json); other flags override it. With `frames` in it, models are written with numbers.
    #[arg(long, value_name = "FILE")]
    pub job: Option<PathBuf>,
    /// Replace the model's file by the result.
    #[arg(long, conflicts_with = "output")]
    pub in_place: bool,
    /// Write the report to a .json file, or as a page for people to an .html file.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Write the lattice after the correction to a .json file.
    #[arg(long, value_name = "FILE")]
    pub save_controls: Option<PathBuf>,
    /// Number type of the written coordinates.
    #[arg(long, value_enum)]
    pub precision: Option<PrecisionArg>,
    /// Give the result the same bits on every processor. It takes a little longer; the number of threads never matters.
    #[arg(long)]
    pub portable_bits: bool,

    /// Draw the model at rest, deformed and corrected to a .png file; of a film, frames side by side.
    #[arg(long, value_name = "FILE", help_heading = "Pictures")]
    pub picture: Option<PathBuf>,
    /// Draw a film to an animated .png file.
    #[arg(long, value_name = "FILE", help_heading = "Pictures")]
    pub animation: Option<PathBuf>,
    /// What colours of pictures say.
    #[arg(long, value_enum, help_heading = "Pictures")]
    pub color: Option<ColorArg>,
    /// Which way is up in pictures.
    #[arg(long, value_enum, help_heading = "Pictures")]
    pub up: Option<UpArg>,
    /// From where pictures are seen: degrees about the upward axis and from above, -60,22.
    #[arg(long, value_name = "AZIMUTH,ELEVATION", allow_hyphen_values = true, help_heading = "Pictures")]
    pub view: Option<String>,
    /// Width and height of a pose in pictures, in pixels: 520x520.
    #[arg(long, value_name = "WxH", help_heading = "Pictures")]
    pub size: Option<String>,
    /// Draw pictures without the lattice, or the grid of the surface.
    #[arg(long, help_heading = "Pictures")]
    pub no_lattice: bool,

    /// Lay the model along a surface: cylinder:radius=1,height=2, other kinds with their keys, or a file of patches; patch.txt:patch=3 for
    /// one of several.
    #[arg(long, value_name = "KIND:KEYS|FILE", help_heading = "Surface")]
    pub surface: Option<String>,
    /// Where the model lies on the flattened sheet: at=[0.5,0.5],rotate=30,scale=1,height=0,up="z",fit="inside",outside="extend".
    #[arg(long, value_name = "KEYS", help_heading = "Surface")]
    pub place: Option<String>,
    /// Cells of the flattened grid along both directions: 32x32, or one number.
    #[arg(long, value_name = "NxN", help_heading = "Surface")]
    pub grid: Option<String>,
    /// Grid steps over which lengths are kept when the surface is flattened.
    #[arg(long, value_name = "STEPS", help_heading = "Surface")]
    pub reach: Option<usize>,
    /// Divide faces where the surface curves by more than this, in 1/extent; or "off".
    #[arg(long, value_name = "CURVATURE", help_heading = "Surface")]
    pub refine: Option<String>,
    /// Write the surface as a mesh, to look at it.
    #[arg(long, value_name = "FILE", help_heading = "Surface")]
    pub save_surface: Option<PathBuf>,
    /// Draw the flattened sheet with the model's vertex, edge and face points to an .svg file.
    #[arg(long, value_name = "FILE", help_heading = "Surface")]
    pub sheet: Option<PathBuf>,

    /// Control points along the axes: 6x6x6, or one number for all.
    #[arg(long, value_name = "NxNxN", help_heading = "Lattice")]
    pub lattice: Option<String>,
    /// Basis functions.
    #[arg(long, value_enum, help_heading = "Lattice")]
    pub basis: Option<BasisArg>,
    /// Degree of B-splines: one number or three with commas.
    #[arg(long, value_name = "D", help_heading = "Lattice")]
    pub degree: Option<String>,
    /// Knots of B-splines; explicit ones need a job or lattice file.
    #[arg(long, value_enum, help_heading = "Lattice")]
    pub knots: Option<KnotsArg>,
    /// Grow the fitted box by this fraction of its extent on every side.
    #[arg(long, value_name = "FRACTION", allow_negative_numbers = true, help_heading = "Lattice")]
    pub margin: Option<f64>,
    /// What happens to vertices outside the lattice.
    #[arg(long, value_enum, help_heading = "Lattice")]
    pub outside: Option<OutsideArg>,
    /// Take the lattice, its pose and mobility from a file.
    #[arg(long, value_name = "FILE", help_heading = "Lattice")]
    pub lattice_file: Option<PathBuf>,

    /// Deform by a cage, a closed mesh, instead of a lattice: cage.obj:posed="cage-posed.obj",coordinates="green".
    #[arg(long, value_name = "FILE[:KEYS]", help_heading = "Cage")]
    pub cage: Option<String>,

    /// Twist about an axis: z=90 (degrees).
    #[arg(long, value_name = "AXIS=DEGREES", help_heading = "Edits")]
    pub twist: Vec<String>,
    /// Bend an axis, towards another if given: z=45 or z=45,-x.
    #[arg(long, value_name = "AXIS=DEGREES[,AXIS]", help_heading = "Edits")]
    pub bend: Vec<String>,
    /// Scale cross-sections linearly up to the high end: z=0.5.
    #[arg(long, value_name = "AXIS=FACTOR", help_heading = "Edits")]
    pub taper: Vec<String>,
    /// Scale along an axis: z=0.5.
    #[arg(long, value_name = "AXIS=FACTOR", help_heading = "Edits")]
    pub stretch: Vec<String>,
    /// Rotate about an axis through the middle: z=30 (degrees).
    #[arg(long, value_name = "AXIS=DEGREES", help_heading = "Edits")]
    pub rotate: Vec<String>,
    /// Scale about the middle: 1.2, or three factors with commas.
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true, help_heading = "Edits")]
    pub scale: Vec<String>,
    /// Move control points by a vector in extents: k=5:0,0,-0.4.
    #[arg(long = "move", value_name = "NODES:X,Y,Z", help_heading = "Edits")]
    pub shift: Vec<String>,
    /// Move control points by what of a vector in extents keeps the volume: v=3:0,0.2,0.1 (v: vertices of a cage).
    #[arg(long, value_name = "NODES:X,Y,Z", help_heading = "Edits")]
    pub slide: Vec<String>,
    /// Move every coordinate at random by up to so many extents: 0.05 or 0.05,SEED.
    #[arg(long, value_name = "AMPLITUDE", help_heading = "Edits")]
    pub noise: Vec<String>,
    /// Bring a vertex to a place in model coordinates and keep it there: 1204:0.1,0.2,0.9.
    #[arg(long, value_name = "VERTEX:X,Y,Z", help_heading = "Edits")]
    pub drag: Vec<String>,
    /// Any edit as in a job file: 'twist = { axis = "z", degrees = 90, range = [0.5, 1] }'.
    #[arg(long, value_name = "TOML", help_heading = "Edits")]
    pub edit: Vec<String>,

    /// How to keep the volume: axes such as xy or zyx, "nearest", "gradient", "elastic", or "free".
    #[arg(long, value_name = "HOW", help_heading = "Volume")]
    pub preserve: Option<String>,
    /// The method; with --preserve AXES, nearest and gradient move control points along these axes only.
    #[arg(long, value_enum, help_heading = "Volume")]
    pub method: Option<MethodArg>,
    /// How nodes settle, with the method "elastic": hold={k=[0,2]},net="14",continuity="c1",center_of_mass="keep"; its method is then the
    /// default.
    #[arg(long, value_name = "KEYS", help_heading = "Volume")]
    pub elastic: Option<String>,
    /// What the correction keeps small.
    #[arg(long, value_enum, help_heading = "Volume")]
    pub objective: Option<ObjectiveArg>,
    /// The wanted volume: rest, free, 120%, a number, or a range such as 95%..105%; for several volumes each, each=110%, or
    /// material=100%,capacity=110%.
    #[arg(long, value_name = "VOLUME", help_heading = "Volume")]
    pub volume: Option<String>,
    /// The wanted volume of some components together, instead of --volume: 0,2=110%. May be repeated.
    #[arg(long, value_name = "COMPONENTS=VOLUME", help_heading = "Volume")]
    pub part: Vec<String>,
    /// Relative shares of the axes, with commas: 1,2.
    #[arg(long, value_name = "SHARES", help_heading = "Volume")]
    pub shares: Option<String>,
    /// Control points that the correction does not move: all, k=0, "i=0,5 k=2".
    #[arg(long, value_name = "NODES", help_heading = "Volume")]
    pub pin: Option<String>,
    /// Where the correction happens: everywhere, or where volume was lost.
    #[arg(long, value_enum, help_heading = "Volume")]
    pub mobility: Option<MobilityArg>,
    /// Correct near a vertex only: its number and a radius in extents, 1204:0.3.
    #[arg(long, value_name = "VERTEX:RADIUS", help_heading = "Volume")]
    pub falloff: Option<String>,
    /// A vertex that must come to an exact place, in model coordinates: 1204:0.1,0.2,0.9. May be repeated.
    #[arg(long, value_name = "VERTEX:X,Y,Z", help_heading = "Volume")]
    pub point: Vec<String>,
    /// Correct a mesh of about so many faces instead of the model, for speed: the volume is then approximate.
    #[arg(long, value_name = "FACES", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Volume")]
    pub preview: Option<u32>,
    /// What to do about open models.
    #[arg(long, value_enum, help_heading = "Volume")]
    pub open: Option<OpenArg>,

    /// Edit flags in the order in which they were typed: name and text.
    #[arg(skip)]
    pub edits_in_order: Vec<(&'static str, String)>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum PrecisionArg {
    /// As the input file had.
    File,
    /// 64-bit floats.
    F64,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ColorArg {
    /// By what factor the volume of a small piece changed.
    Volume,
    /// By what factor the last step, edits or correction, changed it.
    Steps,
    /// How far vertices moved.
    Displacement,
    /// By what angle directions turned, beyond rotations: local stress.
    Stress,
    /// Nothing.
    Plain,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum UpArg {
    /// The first coordinate.
    X,
    /// The second coordinate.
    Y,
    /// The third coordinate.
    Z,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum BasisArg {
    /// B-splines of a chosen degree.
    Bspline,
    /// Bernstein polynomials of degree size − 1.
    Bernstein,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum KnotsArg {
    /// The lattice ends at the box.
    Clamped,
    /// The lattice reaches beyond the box.
    Uniform,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum OutsideArg {
    /// They stay where they are.
    Keep,
    /// They follow the tangents of the deformation.
    Extend,
    /// They are an error.
    Refuse,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum MethodArg {
    /// The smallest displacement of the control points.
    Nearest,
    /// One exact step in all coordinates.
    Gradient,
    /// One direction after the other.
    Axes,
    /// A common factor of all heights over a surface.
    Height,
    /// Nodes that no edit moved settle as springs between them want.
    Elastic,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ObjectiveArg {
    /// The displacement of the control points.
    Controls,
    /// The displacement of the vertices.
    Surface,
    /// The changes of the lattice's edges.
    Edges,
    /// The bending of the lattice.
    Bending,
    /// Local stress at points in the cage.
    Stress,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum MobilityArg {
    /// Everywhere alike.
    Uniform,
    /// The more, the more volume was lost.
    Auto,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum OpenArg {
    /// Close openings virtually.
    Cap,
    /// Refuse them.
    Refuse,
}

/// The flags that are edits.
const EDIT_FLAGS: [&str; 11] =
    ["twist", "bend", "taper", "stretch", "rotate", "scale", "shift", "slide", "noise", "drag", "edit"];

/// Reads the command line; on bad usage, prints why and ends with exit code 2.
pub fn parse() -> Cli {
    let matches = Cli::command().try_get_matches().unwrap_or_else(|error| {
        if error.use_stderr() && std::env::args_os().any(|arg| arg == "--json") {
            let text = error.to_string();
            let lines: Vec<&str> = text.lines().take_while(|line| !line.is_empty()).map(str::trim).collect();
            let what = lines.join(" ").trim_start_matches("error: ").to_owned();
            Terminal::new(&OutputArgs { json: true, quiet: true, threads: None }).failure(&Failure::usage(
                "command line",
                what,
                "see isochor --help",
            ));
        }
        error.exit()
    });
    let mut cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    if let (Command::Deform(deform), Some(matches)) = (&mut cli.command, matches.subcommand_matches("deform")) {
        let mut edits = Vec::new();
        for flag in EDIT_FLAGS {
            let indices = matches.indices_of(flag).into_iter().flatten();
            let texts = matches.get_many::<String>(flag).into_iter().flatten();
            edits.extend(indices.zip(texts).map(|(index, text)| (index, flag, text.clone())));
        }
        edits.sort_by_key(|(index, ..)| *index);
        deform.edits_in_order = edits.into_iter().map(|(_, flag, text)| (flag, text)).collect();
    }
    cli
}
