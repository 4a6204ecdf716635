//! Numbers of a body as functions of the places of its nodes: volumes and moments, their gradients, and their second derivatives.
//!
//! The same numbers come from a mesh ([`MeshMeasure`]), from a form of the nodes alone ([`FormMeasure`]), or from a coarse body that stands for a
//! fine one ([`Tilted`]).

use std::borrow::Cow;
use std::cell::Cell;
use std::sync::OnceLock;

use glam::{DMat3, DVec3};

use crate::binding::Binding;
use crate::block_matrix::{BlockPattern, Neighbours};
use crate::correct::Slope;
use crate::couplings::Couplings;
use crate::goals::Goals;
use crate::moments::{Combination, Moments, control_gradients, cross_matrix, relative};
use crate::spare::Spare;
use crate::volume::Solid;
use crate::volume_form::{VolumeForm, offset};

/// Numbers at some places of the nodes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Survey {
    /// The numbers (#numbers): the volume of each goal, then moments.
    pub(crate) values: Vec<f64>,
    /// Their gradients (#numbers × #nodes × 3).
    pub(crate) gradients: Vec<Vec<DVec3>>,
}

/// Numbers of a body.
pub(crate) trait Measure {
    /// With the nodes at `places` (#nodes × 3).
    fn survey(&self, places: &[DVec3]) -> Survey;

    /// Which nodes it couples.
    fn neighbours(&self) -> Neighbours;

    /// Adds `Σ factor · second derivative` (#numbers factors) to the values of a matrix.
    fn add_second(&self, places: &[DVec3], factors: &[f64], pattern: &BlockPattern, values: &mut [f64]);
}

/// Which numbers.
#[derive(Clone, Debug)]
pub(crate) struct Numbers {
    pub(crate) goals: Goals,
    /// Moments, and about which point.
    pub(crate) moments: Vec<Combination>,
    pub(crate) about: DVec3,
}

impl Numbers {
    /// Of each component what the factors of its goals add up to.
    fn weights(&self, factors: &[f64], components: usize) -> Vec<f64> {
        let counted = |c: usize| (0..self.goals.len()).filter(move |goal| self.goals.counts(*goal, c));
        (0..components).map(|c| counted(c).map(|goal| factors[goal]).sum()).collect()
    }
}

/// A body whose vertices follow the nodes.
#[derive(Debug)]
pub(crate) struct MeshMeasure<'a> {
    pub(crate) solid: Cow<'a, Solid>,
    pub(crate) binding: Cow<'a, Binding>,
    /// The vertices with the nodes at rest (#vertices × 3).
    pub(crate) points: Cow<'a, [DVec3]>,
    /// The nodes at rest (#nodes × 3).
    pub(crate) rest: Cow<'a, [DVec3]>,
    pub(crate) numbers: Numbers,
    couplings: OnceLock<Couplings>,
    spare: Spare,
    /// Surveys so far.
    surveys: Cell<usize>,
}

impl<'a> MeshMeasure<'a> {
    pub(crate) fn new(
        solid: Cow<'a, Solid>,
        binding: Cow<'a, Binding>,
        points: Cow<'a, [DVec3]>,
        rest: Cow<'a, [DVec3]>,
        numbers: Numbers,
    ) -> Self {
        let (couplings, spare, surveys) = (OnceLock::new(), Spare::default(), Cell::new(0));
        Self { solid, binding, points, rest, numbers, couplings, spare, surveys }
    }

    /// The vertices with the nodes at `places`.
    pub(crate) fn vertices(&self, places: &[DVec3]) -> Vec<DVec3> {
        let by: Vec<DVec3> = places.iter().zip(&*self.rest).map(|(c, at)| *c - *at).collect();
        self.binding.displaced(&self.points, &by)
    }

    /// Surveys so far.
    pub(crate) fn surveys(&self) -> usize {
        self.surveys.get()
    }

    fn couplings(&self) -> &Couplings {
        self.couplings.get_or_init(|| Couplings::of(&self.solid, &self.binding))
    }
}

impl Measure for MeshMeasure<'_> {
    fn survey(&self, places: &[DVec3]) -> Survey {
        self.surveys.set(self.surveys.get() + 1);
        let vertices = self.vertices(places);
        let Numbers { goals, moments, about } = &self.numbers;
        let swept = goals.is_whole().then(|| Slope::with_volumes(&self.solid, &self.binding, &vertices)).flatten();
        let mut survey = match swept {
            Some((volumes, slope)) => Survey { values: vec![volumes.total], gradients: vec![slope.controls] },
            None => {
                let gradients = goals.gradients(&self.solid, &vertices, &self.spare);
                Survey {
                    values: goals.volumes(&self.solid.volumes(&vertices)),
                    gradients: (0..goals.len()).map(|goal| gradients.adjoint(goal, &self.binding)).collect(),
                }
            }
        };
        if !moments.is_empty() {
            let of_pose = Moments::of(&self.solid, &vertices, *about);
            survey.values.extend(moments.iter().map(|combination| of_pose.of_combination(combination)));
            survey.gradients.extend(control_gradients(moments, &self.solid, &self.binding, &vertices, *about));
        }
        survey
    }

    fn neighbours(&self) -> Neighbours {
        self.couplings().neighbours()
    }

    fn add_second(&self, places: &[DVec3], factors: &[f64], pattern: &BlockPattern, values: &mut [f64]) {
        let vertices = self.vertices(places);
        let weights = self.numbers.weights(factors, self.solid.component_count());
        let points = relative(&self.solid, &vertices, self.numbers.about);
        if self.numbers.moments.is_empty() {
            // Relative to its first corner a triangle v, w, x adds u ↦ u × x/6 and u ↦ w/6 × u: what that leaves out cancels round v.
            let sums = self.couplings().sums(&self.solid, |component, [v, w, x]| {
                let [p, q, r] = [v, w, x].map(|v| points[v as usize]);
                let sixth = weights[component] / 6.0;
                [[0.0; 3], ((r - p) * sixth).to_array(), ((p - q) * sixth).to_array()]
            });
            pattern.for_each_block(|a, b, place| {
                if a != b {
                    pattern.add(values, a, b, -cross_matrix(DVec3::from_array(sums[place])));
                }
            });
            return;
        }
        let mut combination = Combination::ZERO;
        for (moment, factor) in self.numbers.moments.iter().zip(&factors[self.numbers.goals.len()..]) {
            combination.first += *factor * moment.first;
            combination.second += *factor * moment.second;
        }
        let sums = self.couplings().sums(&self.solid, |component, corners| {
            let of_component = Combination { volume: weights[component], ..combination };
            of_component.second_derivatives(corners.map(|v| points[v as usize]))
        });
        pattern.for_each_block(|a, b, place| {
            pattern.add(values, a, b, DMat3::from_cols_array(&sums[place]).transpose());
        });
    }
}

/// Volumes as forms of some of the nodes; the others are held where they are.
#[derive(Clone, Debug)]
pub(crate) struct FormMeasure {
    /// One for each goal.
    forms: Vec<VolumeForm>,
    /// The nodes of the forms, ascending.
    nodes: Vec<usize>,
    size: [usize; 3],
}

impl FormMeasure {
    /// Of the goals of a mesh, for the nodes `nodes`, the others being at `places` (#nodes × 3).
    pub(crate) fn of(mesh: &MeshMeasure, nodes: Vec<usize>, places: &[DVec3]) -> Self {
        let goals = &mesh.numbers.goals;
        let forms = if nodes.len() == places.len() && goals.is_whole() {
            vec![VolumeForm::new(&mesh.solid, &mesh.points, &mesh.binding, &mesh.rest)]
        } else {
            let offset = offset(&mesh.points, &mesh.binding, &mesh.rest, places, &nodes);
            let form =
                |goal| VolumeForm::of(&mesh.solid, &mesh.binding, &nodes, Some(&offset), |c| goals.counts(goal, c));
            (0..goals.len()).map(form).collect()
        };
        Self { forms, nodes, size: mesh.binding.size() }
    }

    fn of_nodes(&self, places: &[DVec3]) -> Vec<DVec3> {
        self.nodes.iter().map(|node| places[*node]).collect()
    }
}

impl Measure for FormMeasure {
    fn survey(&self, places: &[DVec3]) -> Survey {
        let own = self.of_nodes(places);
        let mut survey = Survey::default();
        for state in self.forms.iter().map(|form| form.at(&own)) {
            let mut gradient = vec![DVec3::ZERO; places.len()];
            self.nodes.iter().zip(&state.gradient).for_each(|(node, g)| gradient[*node] = *g);
            survey.values.push(state.volume);
            survey.gradients.push(gradient);
        }
        survey
    }

    fn neighbours(&self) -> Neighbours {
        Neighbours { size: self.size, reach: self.size.map(|n| n - 1) }
    }

    fn add_second(&self, places: &[DVec3], factors: &[f64], pattern: &BlockPattern, values: &mut [f64]) {
        let own = self.of_nodes(places);
        for (form, factor) in self.forms.iter().zip(factors) {
            form.at(&own).for_each_pair(|a, b, s| {
                pattern.add(values, self.nodes[a], self.nodes[b], -cross_matrix(*factor * s));
            });
        }
    }
}

/// A measure with a linear function of the places added to each number.
pub(crate) struct Tilted<'a> {
    measure: &'a dyn Measure,
    /// (#numbers)
    offset: Vec<f64>,
    /// (#numbers × #nodes × 3)
    slope: Vec<Vec<DVec3>>,
}

impl<'a> Tilted<'a> {
    /// `measure`, tilted such that it has the numbers and gradients `wanted` at `places`.
    pub(crate) fn to(measure: &'a dyn Measure, places: &[DVec3], wanted: &Survey) -> Self {
        let there = measure.survey(places);
        let difference = |(wanted, there): (&Vec<DVec3>, &Vec<DVec3>)| -> Vec<DVec3> {
            wanted.iter().zip(there).map(|(wanted, there)| *wanted - *there).collect()
        };
        let slope: Vec<Vec<DVec3>> = wanted.gradients.iter().zip(&there.gradients).map(difference).collect();
        let offset = |k: usize| wanted.values[k] - there.values[k] - product(&slope[k], places);
        Self { measure, offset: (0..slope.len()).map(offset).collect(), slope }
    }
}

impl Measure for Tilted<'_> {
    fn survey(&self, places: &[DVec3]) -> Survey {
        let mut survey = self.measure.survey(places);
        for (k, slope) in self.slope.iter().enumerate() {
            survey.values[k] += self.offset[k] + product(slope, places);
            survey.gradients[k].iter_mut().zip(slope).for_each(|(g, s)| *g += *s);
        }
        survey
    }

    fn neighbours(&self) -> Neighbours {
        self.measure.neighbours()
    }

    fn add_second(&self, places: &[DVec3], factors: &[f64], pattern: &BlockPattern, values: &mut [f64]) {
        self.measure.add_second(places, factors, pattern, values);
    }
}

/// Σ a · b
fn product(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

#[cfg(test)]
mod tests {
    use glam::BVec3;

    use super::*;
    use crate::bspline::Basis;
    use crate::goals::{Components, VolumeGoal};
    use crate::lattice::{Frame, Lattice, Outside};
    use crate::mesh::Mesh;
    use crate::moments::combinations;
    use crate::shapes;
    use crate::topology::topology;
    use crate::volume::OpenBoundaries;

    /// Gradients against differences of values, second derivatives against those of gradients: of a body with caps, kept vertices and several
    /// components.
    #[test]
    fn derivatives_are_those_of_the_numbers() {
        let chain = shapes::chain(2, 9, 5);
        let faces = chain.faces().iter().skip(7).collect();
        let mesh = Mesh::new(chain.points().to_vec(), faces).unwrap();
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Cap).unwrap();
        assert!(solid.cap_count() > 0 && solid.component_count() == 2);
        let bounds = mesh.bounds().unwrap();
        let frame = Frame::fitted(bounds, -0.05).unwrap();
        let lattice = Lattice::new([5, 4, 3].map(|n| Basis::clamped(n, 2).unwrap()), frame).unwrap();
        let binding = lattice.bind(mesh.points(), Outside::Keep).unwrap();
        assert!(binding.kept_count() > 0);
        let rest = lattice.rest();
        let goal = |component| VolumeGoal { components: Components::These(vec![component]), volume: 1.0 };
        for moments in [Vec::new(), combinations(true)] {
            let goals = Goals::new(&[goal(0), goal(1)], 2).unwrap().of(&solid);
            let numbers = Numbers { goals, moments, about: DVec3::new(0.3, -0.2, 0.1) };
            let (solid, binding) = (Cow::Borrowed(&solid), Cow::Borrowed(&binding));
            let mesh = MeshMeasure::new(solid, binding, Cow::Borrowed(mesh.points()), Cow::Borrowed(&rest), numbers);
            let places: Vec<DVec3> =
                rest.iter().map(|c| *c + 0.3 * DVec3::new(c.y * c.y, c.z * c.x, -c.x * c.y)).collect();
            let along: Vec<DVec3> =
                rest.iter().map(|c| DVec3::new(c.z.sin(), (3.0 * c.x).cos(), c.y - 0.5 * c.x)).collect();
            let off = |h: f64| -> Vec<DVec3> { places.iter().zip(&along).map(|(c, d)| *c + h * *d).collect() };
            let h = 1e-5;
            let (at, high, low) = (mesh.survey(&places), mesh.survey(&off(h)), mesh.survey(&off(-h)));
            let factors: Vec<f64> = (0..at.values.len()).map(|k| 1.0 + 0.5 * (k as f64).cos()).collect();
            for k in 0..at.values.len() {
                let rate = (high.values[k] - low.values[k]) / (2.0 * h);
                let expected = product(&at.gradients[k], &along);
                assert!((rate - expected).abs() < 1e-7 * (1.0 + expected.abs()), "{k}: {rate} {expected}");
            }
            let pattern = BlockPattern::new(mesh.neighbours(), &vec![BVec3::TRUE; rest.len()]).unwrap();
            let mut values = vec![0.0; pattern.values()];
            mesh.add_second(&places, &factors, &pattern, &mut values);
            let v = pattern.pulled(&along);
            let mut found = vec![0.0; v.len()];
            for entry in pattern.matrix(&values).triplet_iter() {
                found[entry.row] += *entry.val * v[entry.col];
                if entry.row != entry.col {
                    found[entry.col] += *entry.val * v[entry.row];
                }
            }
            for (node, found) in found.chunks(3).enumerate() {
                let rate = |k: usize| factors[k] * (high.gradients[k][node] - low.gradients[k][node]) / (2.0 * h);
                let expected: DVec3 = (0..factors.len()).map(rate).sum();
                assert!(
                    (DVec3::from_slice(found) - expected).length() < 1e-7,
                    "{} {node}: {found:?} {expected}",
                    factors.len()
                );
            }
        }
    }
}
