//! Triangles that come and go, in a grid of boxes, to ask which are near another.

use glam::DVec3;

/// Boxes along the longest side. Larger: a large triangle is in more boxes; smaller: a box has more triangles.
const BOXES: f64 = 32.0;

/// Numbers of triangles by the boxes that their own boxes touch. Beyond the grid they are in its outermost boxes.
pub(crate) struct Buckets {
    low: DVec3,
    step: f64,
    size: [usize; 3],
    triangles: Vec<Vec<u32>>,
}

impl Buckets {
    /// Without triangles yet, for such as are about as far apart as `points`.
    pub(crate) fn over(points: &[DVec3]) -> Self {
        let low = points.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
        let high = points.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
        let step = (high - low).max_element() / BOXES;
        let size = ((high - low) / step).to_array().map(|n| n as usize + 1);
        Self { low, step, size, triangles: vec![Vec::new(); size.iter().product()] }
    }

    /// The boxes that the box of a triangle touches.
    fn boxes(&self, [a, b, c]: [DVec3; 3]) -> Vec<usize> {
        let [nx, ny, _] = self.size;
        let along = |axis: usize| {
            let place = |x: f64| (((x - self.low[axis]) / self.step).max(0.0) as usize).min(self.size[axis] - 1);
            place(a.min(b).min(c)[axis])..=place(a.max(b).max(c)[axis])
        };
        let [x, y, z] = [0, 1, 2].map(along);
        let mut boxes = Vec::new();
        for k in z {
            for j in y.clone() {
                boxes.extend(x.clone().map(|i| (k * ny + j) * nx + i));
            }
        }
        boxes
    }

    pub(crate) fn insert(&mut self, triangle: u32, corners: [DVec3; 3]) {
        for b in self.boxes(corners) {
            self.triangles[b].push(triangle);
        }
    }

    pub(crate) fn remove(&mut self, triangle: u32, corners: [DVec3; 3]) {
        for b in self.boxes(corners) {
            self.triangles[b].retain(|t| *t != triangle);
        }
    }

    /// All triangles that could touch one with these corners; some more than once.
    pub(crate) fn near(&self, corners: [DVec3; 3]) -> impl Iterator<Item = u32> {
        self.boxes(corners).into_iter().flat_map(|b| self.triangles[b].iter().copied())
    }
}
