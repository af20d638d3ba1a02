//! Every loss against central differences, and the losses at the truth.

use nalgebra::{Point3, Vector3};

use crate::neural::{
    collision::collision_loss,
    config::{ArticulationConfig, LossWeights},
    consistency::Consistency,
    motion_params::{Motions, Way},
    objective::{ArticulationLosses, Objective, StateBatch},
    occupancy::{BackwardFlow, occupancy_loss},
    ray_batch::RayBatch,
    segmentation::{GumbelNoise, SegmentationField},
    state_model::Volume,
    test_scene::{TestScene, two_blocks},
    uniform_batch::{OccupiedState, OccupiedVoxels, UniformBatch},
};
use geometry::Pose;
use numeric::random::stage_rng;

fn scene() -> TestScene {
    two_blocks(Pose::new(Vector3::new(0.05, -0.03, 0.04), Vector3::new(0.0, 0.1, 0.4)), 61)
}

/// A small step whose loss and gradient can be asked for changed motions and fields.
struct Fixture<'a> {
    scene: &'a TestScene,
    config: ArticulationConfig,
    source: usize,
    motions: Motions,
    field: SegmentationField,
    rays: [RayBatch; 2],
    uniform: UniformBatch,
}

impl<'a> Fixture<'a> {
    fn new(scene: &'a TestScene, weights: LossWeights, source: usize) -> Self {
        let config = ArticulationConfig {
            rays: 60,
            uniform_points: 600,
            grid_nodes: 9,
            // Visibility is no function of the parameters in these gradients, so none is discounted.
            unseen_weight: 1.0,
            weights,
            ..ArticulationConfig::default()
        };
        let mut rng = stage_rng(5, "test/gradient", source as u64);
        let near = Pose::new(Vector3::new(0.07, -0.02, 0.03), Vector3::new(0.05, 0.05, 0.3));
        let motions = Motions::from_world(&[Pose::identity(), near], &scene.scene);
        let mut field = SegmentationField::random_field(2, config.grid_nodes, &mut rng);
        let mut draw = || (rand_core::Rng::next_u32(&mut rng) >> 8) as f32 / (1u32 << 23) as f32 - 1.0;
        field.grid.iter_mut().for_each(|g| *g = draw());
        let [v0, v1] = [0, 1].map(|state| Self::volume(scene, state));
        let rays = [RayBatch::draw(&v0, &config, &mut rng), RayBatch::draw(&v1, &config, &mut rng)];
        let o0 = OccupiedVoxels::of(&v0);
        let o1 = OccupiedVoxels::of(&v1);
        let states = [OccupiedState { volume: &v0, voxels: &o0 }, OccupiedState { volume: &v1, voxels: &o1 }];
        let [here, other] = [states[1 - source], states[source]];
        let back = Way::from_state(source).reverse();
        let uniform = UniformBatch::draw(config.uniform_points, here, other, &motions, back, &mut rng);
        Self { scene, config, source, motions, field, rays, uniform }
    }

    /// With a wide ramp, so that many points lie on it.
    fn volume(scene: &TestScene, state: usize) -> Volume<'_> {
        Volume { ramp_m: 0.04, ..scene.volume(state) }
    }

    fn evaluate(
        &self,
        motions: &Motions,
        field: &SegmentationField,
    ) -> (ArticulationLosses, crate::neural::segmentation::SegmentationGradient, Vec<f64>) {
        let volumes = [0, 1].map(|state| Self::volume(self.scene, state));
        let objective = Objective {
            source: &volumes[self.source],
            target: &volumes[1 - self.source],
            way: Way::from_state(self.source),
            motions,
            config: &self.config,
        };
        let batch = StateBatch {
            rays: &self.rays[self.source],
            matches: &self.scene.matches[..100],
            uniform: Some(&self.uniform),
            collision: Some(&self.rays[1 - self.source].points),
            noise: GumbelNoise { key: Some(9) },
        };
        let mut gradient = field.zero_gradient();
        let (losses, by_motions) = objective.evaluate(field, &batch, &mut gradient);
        (losses, gradient, by_motions.parts[1].iter().flat_map(|v| [v.x, v.y, v.z]).collect())
    }

    /// Checks the six coordinates of the motion, then the direction of the gradient for the field's grid and
    /// each layer.
    fn check(&self) {
        self.check_motions();
        let (losses, gradient, _) = self.evaluate(&self.motions, &self.field);
        assert!(losses.total > 1e-6, "the loss is there: {losses:?}");
        self.check_direction("grid", &gradient.grid, |f| &mut f.grid);
        for l in 0..3 {
            self.check_direction("weights", &gradient.layers[l].weights, |f| &mut f.layers[l].weights);
            self.check_direction("biases", &gradient.layers[l].biases, |f| &mut f.layers[l].biases);
        }
    }

    fn check_motions(&self) {
        let by_motion = self.evaluate(&self.motions, &self.field).2;
        let scale = by_motion.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        for (k, analytic) in by_motion.iter().enumerate() {
            let value = |d: f64| self.evaluate(&self.motions.nudged(1, k, d), &self.field).0.total;
            let numeric = (value(2e-4) - value(-2e-4)) / 4e-4;
            assert!(
                (numeric - analytic).abs() < 0.01 * scale,
                "motion {k}: {analytic} against {numeric}; largest {scale}"
            );
        }
    }

    /// Moves a block of parameters along a random direction and along its gradient.
    fn check_direction(
        &self,
        name: &str,
        gradient: &[f32],
        block: impl Fn(&mut SegmentationField) -> &mut Vec<f32>,
    ) {
        let norm = gradient.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        assert!(norm > 0.0, "{name} has a gradient");
        let along: Vec<f64> = gradient.iter().map(|g| f64::from(*g) / norm).collect();
        let mixed: Vec<f64> =
            along.iter().enumerate().map(|(i, a)| if i % 3 == 1 { -2.0 * a } else { *a }).collect();
        for direction in [along, mixed] {
            let value = |d: f64| {
                let mut field = self.field.clone();
                block(&mut field).iter_mut().zip(&direction).for_each(|(p, u)| *p += (d * u) as f32);
                self.evaluate(&self.motions, &field).0.total
            };
            let analytic: f64 = direction.iter().zip(gradient).map(|(u, g)| u * f64::from(*g)).sum();
            // Long steps cross ReLU kinks, short ones drown in f32 rounding.
            let differences = [1e-3, 3e-4, 1e-4].map(|step| (value(step) - value(-step)) / (2.0 * step));
            let error = differences.iter().fold(f64::INFINITY, |best, d| best.min((d - analytic).abs()));
            assert!(error < 0.02 * norm, "{name}: {analytic} against {differences:?}; norm {norm}");
        }
    }
}

const NOTHING: LossWeights =
    LossWeights { sdf: 0.0, color: 0.0, occupancy: 0.0, collision: 0.0, matching: 0.0 };

/// One loss from both states.
fn check(weights: LossWeights) {
    let scene = scene();
    for source in 0..2 {
        Fixture::new(&scene, weights, source).check();
    }
}

#[test]
fn sdf_consistency_has_its_gradient() {
    check(LossWeights { sdf: 10.0, ..NOTHING });
}

#[test]
fn color_consistency_has_its_gradient() {
    check(LossWeights { color: 1.0, ..NOTHING });
}

#[test]
fn occupancy_consistency_has_its_gradient() {
    check(LossWeights { occupancy: 5.0, ..NOTHING });
}

#[test]
fn collision_has_its_gradient() {
    check(LossWeights { collision: 50.0, ..NOTHING });
}

#[test]
fn matching_has_its_gradient() {
    check(LossWeights { matching: 500.0, ..NOTHING });
}

#[test]
fn all_losses_together_have_their_gradient() {
    check(LossWeights::default());
}

/// Probabilities that know the truth, for points of a state.
fn truth(scene: &TestScene, state: usize, points: impl Iterator<Item = Point3<f64>>) -> Vec<f32> {
    points
        .flat_map(|p| {
            [0, 1].map(|i| f32::from(u8::from(scene.shapes[state].nearest(&scene.scene.to_world(&p)).0 == i)))
        })
        .collect()
}

#[test]
fn at_the_truth_no_loss_is_left() {
    let scene = scene();
    let config = ArticulationConfig {
        rays: 400,
        uniform_points: 20_000,
        unseen_weight: 1.0,
        ..ArticulationConfig::default()
    };
    let motions = Motions::from_world(&scene.motions, &scene.scene);
    for source in 0..2 {
        let mut rng = stage_rng(2, "test/truth", source as u64);
        let from = scene.volume(source);
        let to = scene.volume(1 - source);
        let way = Way::from_state(source);
        let rays = RayBatch::draw(&from, &config, &mut rng);
        let consistency =
            Consistency { batch: &rays, source: &from, target: &to, motions: &motions, way, config: &config };
        let p = truth(&scene, source, rays.points.iter().copied());
        // A point may be nearer to the other block there: the blocks move against each other. Most are not.
        let sdf = consistency.sdf_loss(&p).value;
        let color = consistency.color_loss(&p).value;
        let half = vec![0.5; p.len()];
        assert!(sdf < 0.02, "{sdf}");
        assert!(
            consistency.sdf_loss(&half).value > 5.0 * sdf
                && consistency.color_loss(&half).value > 5.0 * color
        );

        let o_from = OccupiedVoxels::of(&from);
        let o_to = OccupiedVoxels::of(&to);
        let uniform = UniformBatch::draw(
            config.uniform_points,
            OccupiedState { volume: &to, voxels: &o_to },
            OccupiedState { volume: &from, voxels: &o_from },
            &motions,
            way.reverse(),
            &mut rng,
        );
        let flow =
            BackwardFlow::gather(&uniform.points, Some(&uniform.weights), &from, &motions, way.reverse());
        let p = truth(&scene, source, flow.candidates.iter().map(|c| c.image));
        let occupancy = occupancy_loss(&flow, &p, &to, &from, &config).value;
        let collision = collision_loss(&flow, &p).value;
        // The published text means the state that the points lie in: the other one has other occupancy there.
        let elsewhere = occupancy_loss(&flow, &p, &from, &to, &config).value;
        assert!(occupancy < 2e-4, "{occupancy}");
        assert!(elsewhere > 20.0 * occupancy.max(1e-4), "{elsewhere} against {occupancy}");
        assert!(collision < 1e-6, "{collision}");
        // A lid that fills what the base fills already.
        let both = vec![1.0; p.len()];
        assert!(collision_loss(&flow, &both).value > 1e-3);
    }
}

#[test]
fn weighted_points_estimate_the_uniform_mean() {
    let scene = scene();
    let motions = Motions::from_world(&scene.motions, &scene.scene);
    let v0 = scene.volume(0);
    let v1 = scene.volume(1);
    let o0 = OccupiedVoxels::of(&v0);
    let o1 = OccupiedVoxels::of(&v1);
    let here = OccupiedState { volume: &v1, voxels: &o1 };
    let other = OccupiedState { volume: &v0, voxels: &o0 };
    let mut rng = stage_rng(8, "test/uniform", 0);
    let batch = UniformBatch::draw(200_000, here, other, &motions, Way::Backward, &mut rng);
    let mean = |f: &dyn Fn(&Point3<f64>) -> f64| {
        batch
            .points
            .iter()
            .zip(&batch.weights)
            .map(|(p, w)| if *w > 0.0 { w * f(p) } else { 0.0 })
            .sum::<f64>()
            / 200_000.0
    };
    assert!((mean(&|_| 1.0) - 1.0).abs() < 0.02, "{}", mean(&|_| 1.0));
    assert!((mean(&|p| p.x * p.x) - 1.0 / 3.0).abs() < 0.02);
    let volume = 8.0 * (0.2 * 0.15 * 0.05 + 0.07 * 0.1 * 0.06) / scene.scene.side_m().powi(3);
    assert!((mean(&|p| v1.occupancy(p).0) / volume - 1.0).abs() < 0.02);
}

/// What an ablation takes out of a step is its own term and nothing else.
#[test]
fn a_switch_takes_out_its_own_term_only() {
    let scene = scene();
    let of = |change: &dyn Fn(&mut ArticulationConfig)| {
        let mut fixture = Fixture::new(&scene, LossWeights::default(), 0);
        // Samples are drawn before: they are the same for all.
        change(&mut fixture.config);
        fixture.evaluate(&fixture.motions, &fixture.field).0
    };
    let terms = |l: &ArticulationLosses| {
        [l.sdf, l.color, l.occupancy, l.collision_rays, l.collision_uniform, l.matching]
    };
    let all = of(&|_| ());
    let w = LossWeights::default();
    let weights = [w.sdf, w.color, w.occupancy, w.collision, w.collision, w.matching];
    assert!(terms(&all).iter().all(|t| *t > 0.0), "{all:?}");
    let switches: [(&dyn Fn(&mut ArticulationConfig), &[usize]); 4] = [
        (&|c| (c.weights.sdf, c.weights.color) = (0.0, 0.0), &[0, 1]),
        (&|c| c.weights.occupancy = 0.0, &[2]),
        (&|c| c.weights.collision = 0.0, &[3, 4]),
        (&|c| c.weights.matching = 0.0, &[5]),
    ];
    for (switch, own) in switches {
        let without = of(switch);
        for (k, (a, b)) in terms(&all).into_iter().zip(terms(&without)).enumerate() {
            let expected = if own.contains(&k) { 0.0 } else { a };
            assert_eq!(b, expected, "term {k} without {own:?}");
        }
        let taken: f64 = own.iter().map(|&k| weights[k] * terms(&all)[k]).sum();
        assert!((all.total - taken - without.total).abs() < 1e-9 * all.total, "{own:?}");
    }
    // Visibility is no term but a weight of consistency and occupancy.
    let without = of(&|c| c.unseen_weight = 0.5);
    let changed: Vec<bool> = terms(&all).into_iter().zip(terms(&without)).map(|(a, b)| a != b).collect();
    assert_eq!(changed, [true, true, true, false, false, false]);
}
