//! Wanted volumes: of the whole body, or of several of its parts at once.
//!
//! A goal is a signed volume for a set of components. Goals are linear in the components' volumes, so goals that follow from others
//! (the whole and all of its parts) are found by elimination before anything moves: they agree, or they contradict.

use std::ops::Range;

use glam::DVec3;

use crate::binding::Binding;
use crate::parallel;
use crate::spare::{Array, Spare};
use crate::tolerances;
use crate::volume::{Solid, Volumes, spread_and_products};

/// A wanted signed volume of the whole body or of some of its components together.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeGoal {
    /// Whose volume is meant: the sum over these.
    pub components: Components,
    /// The wanted volume, signed as [`Solid::volumes`] gives it: a cavity is negative in a body that is positive.
    pub volume: f64,
}

/// Some of the components of a body.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Components {
    /// All of them.
    #[default]
    All,
    /// By index, in the order of [`crate::Volumes::components`].
    These(Vec<usize>),
}

impl VolumeGoal {
    /// Whether it names components that exist, of `count`.
    pub(crate) fn is_of(&self, count: usize) -> Result<(), usize> {
        match &self.components {
            Components::All => Ok(()),
            Components::These(these) => these.iter().find(|c| **c >= count).map_or(Ok(()), |c| Err(*c)),
        }
    }

    /// The volume that is meant, of those of a pose.
    ///
    /// # Panics
    ///
    /// Panics where it names a component that does not exist.
    #[must_use]
    pub fn of(&self, volumes: &Volumes) -> f64 {
        match &self.components {
            Components::All => volumes.total,
            Components::These(these) => these.iter().map(|c| volumes.components[*c]).sum(),
        }
    }
}

/// Why goals cannot be goals.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum GoalFault {
    /// A component that does not exist.
    Missing { goal: usize, component: usize },
    /// A target to which no relative error exists.
    Target { goal: usize },
    /// No component at all, or one twice.
    Components { goal: usize },
    /// A goal that follows from others, which make it `follows`.
    Contradiction { goal: usize, follows: f64 },
}

/// Goals that do not follow from one another.
#[derive(Clone, Debug)]
pub(crate) struct Goals {
    /// Index in the request (#goals).
    pub(crate) index: Vec<usize>,
    /// Whether a component counts (#goals × #components).
    members: Vec<Vec<bool>>,
    /// The wanted volumes (#goals).
    pub(crate) targets: Vec<f64>,
    /// The vertices of each goal's components (#goals), where there are several goals and no vertex is part of two components.
    vertices: Option<Vec<Vec<u32>>>,
}

/// ∂V/∂P of each goal at a pose.
pub(crate) struct Gradients<'a> {
    /// One after the other (#goals × #vertices × 3); that of the whole body alone where there are `vertices`.
    arrays: Vec<Array>,
    /// The vertices that count for each goal: of many goals each costs what its vertices cost.
    vertices: Option<&'a [Vec<u32>]>,
}

impl Goals {
    pub(crate) fn new(wanted: &[VolumeGoal], component_count: usize) -> Result<Self, GoalFault> {
        let mut goals = Self { index: Vec::new(), members: Vec::new(), targets: Vec::new(), vertices: None };
        // Rows in echelon form: (pivot component, coefficients, wanted volume, its magnitude).
        let mut echelon: Vec<(usize, Vec<f64>, f64, f64)> = Vec::new();
        for (goal, VolumeGoal { components, volume }) in wanted.iter().enumerate() {
            if !volume.is_finite() || *volume == 0.0 {
                return Err(GoalFault::Target { goal });
            }
            let members = match components {
                Components::All => vec![true; component_count],
                Components::These(these) => {
                    let mut members = vec![false; component_count];
                    for &component in these {
                        let member = members.get_mut(component).ok_or(GoalFault::Missing { goal, component })?;
                        if std::mem::replace(member, true) {
                            return Err(GoalFault::Components { goal });
                        }
                    }
                    members
                }
            };
            let mut row: Vec<f64> = members.iter().map(|member| f64::from(u8::from(*member))).collect();
            let (mut left, mut magnitude) = (*volume, volume.abs());
            for (pivot, other, other_volume, other_magnitude) in &echelon {
                let factor = row[*pivot];
                if factor != 0.0 {
                    row.iter_mut().zip(other).for_each(|(x, y)| *x -= factor * y);
                    left -= factor * other_volume;
                    magnitude += factor.abs() * other_magnitude;
                }
            }
            /// Coefficients are small fractions; what is smaller is rounding.
            const ZERO: f64 = 1e-9;
            match (0..component_count).find(|c| row[*c].abs() > ZERO) {
                Some(pivot) => {
                    let scale = row[pivot];
                    row.iter_mut().for_each(|x| *x /= scale);
                    echelon.push((pivot, row, left / scale, magnitude / scale.abs()));
                    goals.index.push(goal);
                    goals.members.push(members);
                    goals.targets.push(*volume);
                }
                None if !members.contains(&true) => return Err(GoalFault::Components { goal }),
                None if left.abs() > tolerances::VOLUME * magnitude => {
                    return Err(GoalFault::Contradiction { goal, follows: volume - left });
                }
                None => {}
            }
        }
        Ok(goals)
    }

    /// The same goals for `solid`, whose components they are about.
    pub(crate) fn of(mut self, solid: &Solid) -> Self {
        self.vertices = if self.len() > 1 { vertices_of_components(solid) } else { None }.map(|of_component| {
            let of_goal = |members: &Vec<bool>| {
                let lists = of_component.iter().zip(members).filter(|(_, member)| **member);
                lists.flat_map(|(list, _)| list.iter().copied()).collect()
            };
            self.members.iter().map(of_goal).collect()
        });
        self
    }

    /// Number of goals.
    pub(crate) fn len(&self) -> usize {
        self.targets.len()
    }

    /// Whether these are goals for the same components, one by one.
    pub(crate) fn are_of_the_same(&self, other: &Self) -> bool {
        self.members == other.members
    }

    /// Whether a component counts for a goal.
    pub(crate) fn counts(&self, goal: usize, component: usize) -> bool {
        self.members[goal][component]
    }

    /// The goals' volumes (#goals), of those of a pose.
    pub(crate) fn volumes(&self, volumes: &Volumes) -> Vec<f64> {
        let sum = |members: &Vec<bool>| match members.iter().all(|member| *member) {
            true => volumes.total,
            false => volumes.components.iter().zip(members).filter(|(_, member)| **member).map(|(v, _)| v).sum(),
        };
        self.members.iter().map(sum).collect()
    }

    /// Whether the volume of the whole body is the only goal.
    pub(crate) fn is_whole(&self) -> bool {
        self.len() == 1 && self.members[0].iter().all(|member| *member)
    }

    /// ∂V/∂P of each goal at a pose, in the memory of `spare`.
    pub(crate) fn gradients(&self, solid: &Solid, points: &[DVec3], spare: &Spare) -> Gradients<'_> {
        let filled = |weights: Option<&[f64]>| {
            let mut array = spare.array();
            solid.gradient_into(points, weights, array.memory());
            array
        };
        let of_goal = |members: &Vec<bool>| match members.iter().all(|member| *member) {
            true => filled(None),
            false => filled(Some(&members.iter().map(|member| f64::from(u8::from(*member))).collect::<Vec<_>>())),
        };
        let arrays = match &self.vertices {
            Some(_) => vec![filled(None)],
            None => self.members.iter().map(of_goal).collect(),
        };
        Gradients { arrays, vertices: self.vertices.as_deref() }
    }

    /// `Σ_goals factor · ∇²V_goal q` (#vertices × 3) at a pose along q (#vertices × 3), for one factor per goal.
    pub(crate) fn gradient_change(&self, factors: &[f64], solid: &Solid, points: &[DVec3], q: &[DVec3]) -> Vec<DVec3> {
        let weight = |component: usize| -> f64 {
            self.members.iter().zip(factors).filter(|(members, _)| members[component]).map(|(_, factor)| factor).sum()
        };
        let weights: Vec<f64> = (0..solid.component_count()).map(weight).collect();
        solid.weighted_gradient_change(points, q, &weights)
    }
}

impl Gradients<'_> {
    /// Of a goal at the pose `points`: Σ |∂V/∂p|₁ over the vertices, about the area of its surface and the scale on which its ∇V is rounded;
    /// and its volume, `Σ ∂V/∂p · p / 3`, with the rounding of a plain sum.
    pub(crate) fn spread_and_rough_volume(&self, goal: usize, points: &[DVec3]) -> (f64, f64) {
        let [spread, products] = match self.vertices {
            None => {
                let gradient = &self.arrays[goal];
                let of =
                    |range: Range<usize>| spread_and_products(gradient[range.clone()].iter().copied(), &points[range]);
                let parts = parallel::map_chunks(gradient.len(), parallel::CHUNK, of);
                parts.into_iter().fold([0.0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]])
            }
            Some(vertices) => {
                let pair = |v: &u32| (self.arrays[0][*v as usize], points[*v as usize]);
                let (g, p): (Vec<DVec3>, Vec<DVec3>) = vertices[goal].iter().map(pair).unzip();
                spread_and_products(g.into_iter(), &p)
            }
        };
        (spread, products / 3.0)
    }

    /// ∇V of a goal (#controls × 3).
    pub(crate) fn adjoint(&self, goal: usize, binding: &Binding) -> Vec<DVec3> {
        match self.vertices {
            None => binding.adjoint(&self.arrays[goal]),
            Some(vertices) => binding.adjoint_among(&vertices[goal], |v| self.arrays[0][v]),
        }
    }

    /// ∇V of a goal along `direction` (#controls).
    pub(crate) fn adjoint_along(&self, goal: usize, binding: &Binding, direction: DVec3) -> Vec<f64> {
        match self.vertices {
            None => {
                let gradient = &self.arrays[goal];
                binding.adjoint_scalar(&parallel::collect(gradient.len(), |v| gradient[v].dot(direction)))
            }
            Some(vertices) => binding.adjoint_among(&vertices[goal], |v| self.arrays[0][v].dot(direction)),
        }
    }

    /// The vertices on which a goal depends, with ∂V/∂p.
    pub(crate) fn of_vertices(&self, goal: usize) -> Vec<(usize, DVec3)> {
        let all: Vec<(usize, DVec3)> = match self.vertices {
            None => self.arrays[goal].iter().copied().enumerate().collect(),
            Some(vertices) => vertices[goal].iter().map(|v| (*v as usize, self.arrays[0][*v as usize])).collect(),
        };
        all.into_iter().filter(|(_, g)| *g != DVec3::ZERO).collect()
    }
}

/// The vertices of each component, in ascending order; `None` where one is part of two.
fn vertices_of_components(solid: &Solid) -> Option<Vec<Vec<u32>>> {
    let mut component_of = vec![usize::MAX; solid.vertex_count()];
    for component in 0..solid.component_count() {
        for v in solid.triangles_of(component).as_flattened() {
            let Some(known) = component_of.get_mut(*v as usize) else { continue }; // an apex
            if *known != usize::MAX && *known != component {
                return None;
            }
            *known = component;
        }
    }
    let mut vertices = vec![Vec::new(); solid.component_count()];
    for (v, component) in (0..).zip(component_of).filter(|(_, component)| *component != usize::MAX) {
        vertices[component].push(v);
    }
    Some(vertices)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn goal(components: &[usize], volume: f64) -> VolumeGoal {
        VolumeGoal { components: Components::These(components.to_vec()), volume }
    }

    #[test]
    fn goals_that_follow_from_others_are_left_out_or_contradict() {
        let all = VolumeGoal { components: Components::All, volume: 6.0 };
        let parts = [goal(&[0], 1.0), goal(&[1, 2], 5.0), all];
        let goals = Goals::new(&parts, 3).unwrap();
        assert_eq!((goals.len(), goals.index), (2, vec![0, 1]));
        let contradicting = [goal(&[0, 1], 1.0), goal(&[1, 2], 5.0), goal(&[0], 3.0), goal(&[2], 8.0)];
        let fault = Goals::new(&contradicting, 3).unwrap_err();
        assert_eq!(fault, GoalFault::Contradiction { goal: 3, follows: 7.0 });
    }

    #[test]
    fn faults_are_named() {
        assert_eq!(Goals::new(&[goal(&[3], 1.0)], 3).unwrap_err(), GoalFault::Missing { goal: 0, component: 3 });
        assert_eq!(Goals::new(&[goal(&[1], 1.0), goal(&[0], 0.0)], 3).unwrap_err(), GoalFault::Target { goal: 1 });
        assert_eq!(Goals::new(&[goal(&[1, 1], 1.0)], 3).unwrap_err(), GoalFault::Components { goal: 0 });
        assert_eq!(Goals::new(&[goal(&[], 1.0)], 3).unwrap_err(), GoalFault::Components { goal: 0 });
    }

    #[test]
    fn volumes_are_sums_over_members() {
        let goals = Goals::new(&[goal(&[2, 0], 1.0), VolumeGoal { components: Components::All, volume: 1.0 }], 3);
        let volumes = Volumes { total: -1.0, components: vec![1.0, 2.0, -4.0] };
        assert_eq!(goals.unwrap().volumes(&volumes), [-3.0, -1.0]);
    }
}
