//! Volumes that are wanted at once: of the whole body, or of some of its components together.

/// A wanted signed volume of the whole body or of some of its components together.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeGoal {
    /// Which components.
    pub components: Components,
    /// The sum over these components, in the cube of the pose's length unit; signed as [`Solid::volumes`] gives it.
    ///
    /// [`Solid::volumes`]: crate::Solid::volumes
    pub volume: f64,
}

/// Components of a body.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Components {
    /// All of them: the whole body.
    #[default]
    All,
    /// By index, in the order of [`Volumes::components`](crate::Volumes::components).
    These(Vec<usize>),
}
