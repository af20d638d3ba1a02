//! The surface samples of both states, prepared for search: where each goes under a motion, and its label.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::{
    observations::SurfaceSamples,
    pair::{
        recent::Recent,
        reprojection::{ALL_FREE, FREE, HALF_COST, HIDDEN, Look, Reprojection, TAKEN},
    },
    samples::{
        sample_index::SampleIndex,
        spacing::spacing_m,
        surface_graph::{NORMAL_SIGMA, Of, SurfaceGraph},
    },
};
use geometry::{Pose, all_about};
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Least and largest standard deviation of a surface from its partner, as shares of the reach.
/// chosen: a surface that coincides exactly is not known so well; a reach holds five of the largest
const PLANE: [f64; 2] = [0.02, 0.2];
/// Least and largest standard deviation of a color.
/// chosen: a few levels of noise; beyond the largest, colors say nothing
const COLOR: [f64; 2] = [0.03, 0.15];

/// Whether a world point was seen to be empty in a state.
pub type FreeSpace<'a> = &'a (dyn Fn(&Point3<f64>) -> bool + Sync);

/// Standard deviation of the relative change of light on a surface, per length of the change of its normal.
/// tuned: shared/bags
const SHADING: f64 = 0.5;
/// Largest displacement of a sample by errors of depth, in standard deviations of a plane.
/// chosen: 99 of 100 normal errors
const DEPTH_ERROR: f64 = 2.5;
/// Largest displacement of a sample by errors of a motion and of depth, as a share of the reach.
/// derived: 2.5 deviations of a plane, which are a fifth of the reach at most
const ERROR: f64 = 0.5;
/// Samples farther beyond an edge than this many times their mean distance have no partner.
/// derived: the diagonal of a square of samples
pub(crate) const EDGE: f64 = std::f64::consts::SQRT_2;

/// Standard deviations between corresponding samples of a static surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scales {
    /// Distance to the other state's tangent plane, meters.
    pub plane_m: f64,
    /// Length of the color difference.
    pub color: f64,
}

/// Number of motions whose reprojections are kept.
const KEPT: usize = 48;
/// Number of sets of motions whose labels are kept: repeated sets were among the last ten.
///
/// measured: on laptop, fridge and calvin_table of shared/bags
const LABELINGS: usize = 12;

/// Label of every sample of each state, and its costs, sample-major.
pub(crate) type Labeling = ([Vec<u8>; 2], [Vec<f32>; 2]);

/// The surface samples of both states, prepared for search.
pub(crate) struct SurfacePair<'a> {
    /// Samples of each state.
    pub samples: [&'a SurfaceSamples; 2],
    /// Search index of each state's samples.
    pub indices: [SampleIndex<'a>; 2],
    /// Space seen empty in each state.
    pub free: [Option<FreeSpace<'a>>; 2],
    /// Neighbors along the surface in each state.
    graphs: [SurfaceGraph; 2],
    /// Expected standard deviations.
    pub scales: Scales,
    /// Longest distance of a correspondence, meters.
    pub reach_m: f64,
    /// Mean distance of neighboring samples of each state, meters.
    pub spacing_m: [f64; 2],
    /// Where the samples of a state go under the last few motions.
    reprojections: Recent<(usize, Pose), Vec<Reprojection>>,
    /// Labels under the last few sets of motions.
    pub labelings: Recent<Vec<Pose>, Labeling>,
}

impl<'a> SurfacePair<'a> {
    /// Prepares the search; standard deviations are measured on samples that coincide in both states.
    pub(crate) fn new(
        samples: [&'a SurfaceSamples; 2],
        free: [Option<FreeSpace<'a>>; 2],
        reach_m: f64,
    ) -> Self {
        let indices = samples.map(|s| SampleIndex::new(s, reach_m));
        let graphs = rayon::join(
            || SurfaceGraph::new(samples[0], &indices[0], reach_m),
            || SurfaceGraph::new(samples[1], &indices[1], reach_m),
        )
        .into();
        // The widest scales, until the pair can measure its own.
        let scales = Scales { plane_m: PLANE[1] * reach_m, color: COLOR[1] };
        let spacing_m = samples.map(|s| spacing_m(&s.points, reach_m));
        let mut pair = Self {
            samples,
            indices,
            free,
            graphs,
            scales,
            reach_m,
            spacing_m,
            reprojections: Recent::keeping(KEPT),
            labelings: Recent::keeping(LABELINGS),
        };
        // Static surface shows errors of depth and color without those of a motion.
        pair.scales = pair.static_scales();
        pair
    }

    /// Share of a state's samples that are marked and that the state's own views bear out: none of them saw
    /// their place empty.
    pub(crate) fn borne_out_share(&self, state: usize, marked: &[bool]) -> f64 {
        let points = &self.samples[state].points;
        let is_stray = |p: &Point3<f64>| self.free[state].is_some_and(|is_free| is_free(p));
        let borne_out = points.iter().zip(marked).filter(|(p, marked)| **marked && !is_stray(p)).count();
        borne_out as f64 / points.len().max(1) as f64
    }

    /// Drops all kept results.
    pub(crate) fn forget_results(&self) {
        self.reprojections.clear();
        self.labelings.clear();
    }

    /// Index of the smooth sheet of a sample.
    pub(crate) fn sheet_of(&self, state: usize, sample: usize) -> u32 {
        self.graphs[state].sheet_of(sample)
    }

    /// Neighbors of a sample on its surface.
    pub(crate) fn neighbors_on_surface(&self, state: usize, sample: usize) -> impl Iterator<Item = usize> {
        self.graphs[state].neighbors_on_surface(sample)
    }

    /// Standard deviations, from the medians over samples with a close partner at the same place.
    fn static_scales(&self) -> Scales {
        let [a, b] = self.samples;
        let pairs: Vec<[f64; 2]> = (0..a.points.len())
            .into_par_iter()
            .filter_map(|i| {
                let j = self.indices[1].nearest_sample(&a.points[i], &a.normals[i])?;
                Some([
                    b.normals[j].dot(&(a.points[i] - b.points[j])).abs(),
                    color_distance(a.colors[i], b.colors[j]),
                ])
            })
            .collect();
        // Where nothing stands still, the upper bounds apply.
        let [plane_m, color] = [0, 1].map(|k| {
            let typical = median(pairs.iter().map(|p| p[k]).collect());
            SIGMAS_PER_MAD * typical.unwrap_or(f64::INFINITY)
        });
        Scales {
            plane_m: plane_m.clamp(PLANE[0] * self.reach_m, PLANE[1] * self.reach_m),
            color: color.clamp(COLOR[0], COLOR[1]),
        }
    }

    /// The place in the other state to which a motion takes a sample, meters, and the nearest sample there.
    pub(crate) fn moved_and_nearest(
        &self,
        state: usize,
        sample: usize,
        other_from_this: &Pose,
    ) -> (Point3<f64>, Option<usize>) {
        let these = self.samples[state];
        let point = other_from_this * these.points[sample];
        let normal = other_from_this * these.normals[sample];
        (point, self.indices[1 - state].nearest_sample(&point, &normal))
    }

    /// Where a sample goes in the other state.
    fn reprojection(&self, state: usize, sample: usize, other_from_this: &Pose) -> Reprojection {
        let these = self.samples[state];
        let others = self.samples[1 - state];
        let point = other_from_this * these.points[sample];
        let normal = other_from_this * these.normals[sample];
        let free = self.free[1 - state].map(|is_free| is_free(&point));
        let partner = self.indices[1 - state].nearest_sample(&point, &normal).and_then(|j| {
            let (_, aside) = self.offset_from_plane(1 - state, j, &point);
            // Space seen empty beside a surface is past its edge.
            if free == Some(true) && aside > EDGE {
                return None;
            }
            let shape = self.shape_deviation(1 - state, j, &point, &normal);
            let color = self.color_deviation(
                these.colors[sample],
                others.colors[j],
                (normal - these.normals[sample]).norm(),
            );
            // A shift along the plane also costs a little. The sum is docs/method.md (6.4).
            let side = (point - others.points[j]).norm() / self.reach_m;
            Some((j as u32, shape + side * side, color))
        });
        Reprojection { partner, free }
    }

    /// Whether the other state shows surface like a sample's, in shape and color, within a distance of its
    /// place.
    pub(crate) fn has_alike_nearby(&self, state: usize, sample: usize, distance_m: f64) -> bool {
        let these = self.samples[state];
        let others = self.samples[1 - state];
        let point = these.points[sample];
        let mut is_alike = false;
        self.indices[1 - state].visit_around(&point, |j, p| {
            if is_alike || (p - point).norm() > distance_m {
                return;
            }
            let shape = self.shape_deviation(1 - state, j, &point, &these.normals[sample]);
            let color = self.color_deviation(these.colors[sample], others.colors[j], 0.0);
            is_alike = shape + color < HALF_COST;
        });
        is_alike
    }

    /// Squared deviation of a point with a normal from a sample's plane, by height and by direction.
    fn shape_deviation(
        &self,
        state: usize,
        sample: usize,
        point: &Point3<f64>,
        normal: &Vector3<f64>,
    ) -> f64 {
        let plane = self.offset_from_plane(state, sample, point).0 / self.scales.plane_m;
        let bend = (self.samples[state].normals[sample] - normal).norm() / NORMAL_SIGMA;
        plane * plane + bend * bend
    }

    /// Height of a point above a sample's plane, meters, and its distance along the plane, in mean sample
    /// distances.
    pub(crate) fn offset_from_plane(&self, state: usize, sample: usize, point: &Point3<f64>) -> (f64, f64) {
        let offset = point - self.samples[state].points[sample];
        let normal = self.samples[state].normals[sample];
        let off_m = normal.dot(&offset);
        (off_m, (offset - normal * off_m).norm() / self.spacing_m[state])
    }

    /// Squared deviation between two colors of one surface. `turned` is the length of the change of its
    /// normal in the world: light scales all channels alike, and may have changed in proportion.
    fn color_deviation(&self, a: [f32; 3], b: [f32; 3], turned: f64) -> f64 {
        let [a, b] = [a, b].map(|c| Vector3::from(c).cast::<f64>());
        // Light scales a color: its change is along the sum of both colors, a change of hue is perpendicular
        // to it.
        let difference = a - b;
        let sum = a + b;
        let along = sum.try_normalize(1e-9).map_or(0.0, |direction| direction.dot(&difference).powi(2));
        let own = self.scales.color.powi(2);
        let light = (SHADING * turned * 0.5 * sum.norm()).powi(2);
        (difference.norm_squared() - along).max(0.0) / own + along / (own + light)
    }

    /// Reprojections of all samples of a state; those of the last few motions are kept.
    fn reprojections(&self, state: usize, motion: &Pose) -> Arc<Vec<Reprojection>> {
        self.reprojections.get((state, *motion), || {
            let other_from_this = if state == 0 { *motion } else { motion.inverse() };
            let samples = 0..self.samples[state].points.len();
            samples.into_par_iter().map(|i| self.reprojection(state, i, &other_from_this)).collect()
        })
    }

    /// Cost of one sample by shape alone, and its partner in the other state.
    pub(crate) fn shape_cost(
        &self,
        state: usize,
        sample: usize,
        other_from_this: &Pose,
    ) -> (f32, Option<usize>) {
        let found = self.reprojection(state, sample, other_from_this);
        (
            found.reprojection_cost(Look { label: 0, other_labels: None, colored: false }),
            found.partner.map(|p| p.0 as usize),
        )
    }

    /// The samples of a state with a partner in the other under a motion from state 0 to state 1, each with
    /// its partner.
    pub(crate) fn partners_under(&self, state: usize, motion: &Pose) -> Vec<(usize, usize)> {
        self.reprojections(state, motion)
            .iter()
            .enumerate()
            .filter_map(|(i, l)| l.partner.map(|p| (i, p.0 as usize)))
            .collect()
    }

    /// Costs of all samples of a state under all motions, sample-major. `other_labels` are the labels of the
    /// other state's samples, where known.
    pub(crate) fn costs(&self, state: usize, motions: &[Pose], other_labels: Option<&[u8]>) -> Vec<f32> {
        self.costs_of(state, motions, other_labels.map(|l| (l, TAKEN)), true)
    }

    /// The costs used for labels. Once all parts are known, a motion that takes a sample to a place seen
    /// empty all around is ruled out: it costs [`ALL_FREE`]. While parts are missing, such surface would go
    /// to any other motion that hides it.
    pub(crate) fn label_costs(
        &self,
        state: usize,
        motions: &[Pose],
        other_labels: Option<&[u8]>,
        of: Of,
    ) -> Vec<f32> {
        let taken = match of {
            Of::SomeParts => TAKEN,
            // A surface belongs to one part only: a surface of another part at best hides the sample.
            Of::AllParts => HIDDEN,
        };
        let mut costs = self.costs_of(state, motions, other_labels.map(|l| (l, taken)), true);
        let (Some(is_free), Of::AllParts) = (self.free[1 - state], of) else { return costs };
        let ways: Vec<(Pose, f64)> = motions.iter().map(|motion| self.way_and_error(state, motion)).collect();
        let points = &self.samples[state].points;
        let rows = costs.par_chunks_mut(motions.len()).zip(points);
        rows.for_each(|(row, point)| {
            for (cost, (other_from_this, error_m)) in row.iter_mut().zip(&ways) {
                if *cost >= FREE && all_about(&(other_from_this * point), *error_m, is_free) {
                    *cost = ALL_FREE;
                }
            }
        });
        costs
    }

    /// The motion of the samples of a state to the other one, given the motion from state 0 to state 1, and
    /// how far errors may displace them, meters: a static part has only errors of depth.
    fn way_and_error(&self, state: usize, motion: &Pose) -> (Pose, f64) {
        let stands = *motion == Pose::identity();
        let error_m = if stands { DEPTH_ERROR * self.scales.plane_m } else { ERROR * self.reach_m };
        (if state == 0 { *motion } else { motion.inverse() }, error_m)
    }

    /// The costs by shape alone: light does not turn with a part, and color errors are correlated over a
    /// surface.
    pub(crate) fn shape_costs(
        &self,
        state: usize,
        motions: &[Pose],
        other_labels: Option<&[u8]>,
    ) -> Vec<f32> {
        self.costs_of(state, motions, other_labels.map(|l| (l, TAKEN)), false)
    }

    fn costs_of(
        &self,
        state: usize,
        motions: &[Pose],
        other_labels: Option<(&[u8], f32)>,
        colored: bool,
    ) -> Vec<f32> {
        let all: Vec<Arc<Vec<Reprojection>>> = motions.iter().map(|m| self.reprojections(state, m)).collect();
        (0..self.samples[state].points.len())
            .into_par_iter()
            .flat_map_iter(|i| {
                let found = all.iter().enumerate();
                found
                    .map(move |(k, l)| l[i].reprojection_cost(Look { label: k as u8, other_labels, colored }))
            })
            .collect()
    }

    /// Label of every sample of a state. Mean-field smoothing of the costs comes first; labels then spread
    /// along the surface to samples without evidence, and islands without evidence take the label around
    /// them. Samples out of reach of any evidence are static (label 0).
    pub(crate) fn smoothed_labels(&self, state: usize, costs: &[f32], motions: usize, of: Of) -> Vec<u8> {
        // With no other motion, all of the surface is static.
        if motions == 1 {
            return vec![0; costs.len()];
        }
        let graph = &self.graphs[state];
        let mut labels = graph.filled_labels(graph.mean_field(costs, motions), costs, motions, of);
        graph.join_islands(&mut labels, costs, motions);
        labels
    }
}

/// Length of a color difference.
fn color_distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    let d = [0, 1, 2].map(|k| f64::from(a[k] - b[k]));
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::synthetic::{Scene, camera_ring};

    fn check(scene: &Scene, with_free: bool, percent: usize) {
        let cameras = camera_ring(10);
        let (s0, t0) = scene.surface(0, &cameras, 0.01);
        let (s1, t1) = scene.surface(1, &cameras, 0.01);
        let free0 = |p: &Point3<f64>| scene.is_free(0, &cameras, p);
        let free1 = |p: &Point3<f64>| scene.is_free(1, &cameras, p);
        let free: [Option<FreeSpace<'_>>; 2] =
            if with_free { [Some(&free0), Some(&free1)] } else { [None, None] };
        let pair = SurfacePair::new([&s0, &s1], free, 0.02);
        let motions: Vec<Pose> = (0..scene.parts.len()).map(|k| scene.truth(k)).collect();
        // As in the registration: the labels of one state bind the other.
        let label = |state: usize, others: Option<&[u8]>| {
            let costs = pair.label_costs(state, &motions, others, Of::AllParts);
            pair.smoothed_labels(state, &costs, motions.len(), Of::AllParts)
        };
        let first = label(0, None);
        let second = label(1, Some(&first));
        for (state, truth) in [t0, t1].iter().enumerate() {
            let others = if state == 0 { &second } else { &first };
            let labels = label(state, Some(others));
            let right = labels.iter().zip(truth).filter(|(a, b)| a == b).count();
            assert!(
                right * 100 >= percent * truth.len(),
                "state {state}: {right} of {}, asked for {percent} %",
                truth.len()
            );
        }
    }

    #[test]
    fn true_motions_label_the_parts() {
        check(&Scene::box_with_lid_and_drawer(), true, 92);
        // Without free space nothing speaks about insides that one state alone shows: only what they hang on
        // does.
        check(&Scene::box_with_lid(), false, 80);
        check(&Scene::box_with_lid_and_drawer(), false, 80);
    }

    /// A plate at z = 0 with samples 10 mm apart.
    fn plate(columns: i64) -> SurfaceSamples {
        let points: Vec<Point3<f64>> = (0..columns)
            .flat_map(|x| (0..20).map(move |y| Point3::new(0.01 * x as f64, 0.01 * y as f64, 0.0)))
            .collect();
        SurfaceSamples {
            normals: vec![Vector3::z(); points.len()],
            colors: vec![[0.5; 3]; points.len()],
            points,
        }
    }

    #[test]
    fn what_stands_is_ruled_out_nearer_to_a_border_of_empty_space_than_what_moves() {
        let long = plate(40);
        let short = plate(10);
        let empty = |p: &Point3<f64>| p.x > 0.2;
        let pair = SurfacePair::new([&long, &short], [None, Some(&empty)], 0.04);
        // The shift is along the border, so depths are alike.
        let motions = [Pose::identity(), Pose::translation(0.0, 1e-9, 0.0)];
        let all = pair.label_costs(0, &motions, None, Of::AllParts);
        let at = |column: usize| [0, 1].map(|k| all[2 * (20 * column + 10) + k]);
        // Errors of depth are 2 mm, as the plates coincide; half of the reach is 20 mm.
        assert!((pair.scales.plane_m - 0.0008).abs() < 1e-12, "{}", pair.scales.plane_m);
        assert_eq!(at(15)[0].max(at(15)[1]), 0.9, "hidden");
        assert_eq!(at(21), [ALL_FREE, FREE], "10 mm within");
        assert_eq!(at(23), [ALL_FREE, ALL_FREE], "30 mm within");
        assert!(pair.costs(0, &motions, None).iter().all(|c| *c <= FREE));
    }

    #[test]
    fn surface_that_is_another_parts_explains_a_sample_while_parts_are_missing_only() {
        let both = plate(20);
        let pair = SurfacePair::new([&both, &both], [None, None], 0.04);
        let motions = [Pose::identity(), Pose::translation(0.0, 1e-9, 0.0)];
        let of_first = vec![0; both.points.len()];
        let costs = |of: Of| {
            let all = pair.label_costs(0, &motions, Some(&of_first), of);
            [all[2 * 210], all[2 * 210 + 1]]
        };
        assert_eq!(costs(Of::AllParts), [0.0, HIDDEN]);
        let [own, other] = costs(Of::SomeParts);
        assert!(own == 0.0 && (other - TAKEN).abs() < 1e-5, "{own} {other}");
    }

    #[test]
    fn space_seen_empty_beside_a_surface_is_beyond_its_edge() {
        let long = plate(23);
        let short = plate(20);
        let beyond = |p: &Point3<f64>| p.x > 0.192;
        let costs = |free: Option<FreeSpace<'_>>| {
            let pair = SurfacePair::new([&long, &short], [None, free], 0.04);
            [20, 22].map(|column: usize| pair.shape_costs(0, &[Pose::identity()], None)[20 * column + 10])
        };
        let [near, far] = costs(Some(&beyond));
        assert!(near < 0.5 && far == FREE, "{near} {far}");
        assert!(costs(None).iter().all(|c| *c < 0.5));
    }

    #[test]
    fn true_motions_label_plain_parts() {
        check(&Scene { texture: 0.0, ..Scene::box_with_lid() }, true, 92);
    }
}
