//! Pixel matches lifted to 3D by the depth at both ends, and merged over agreeing views.

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use crate::observations::LiftedMatch;
use capture::{NoiseConfig, PixelMatch, RgbdFrame};
use numeric::index_sets::IndexSets;

/// Half the side of the depth patch of a feature, pixels.
const PATCH_PX: i64 = 2;
/// Fewest readings of a patch on its plane.
const PATCH_READINGS: usize = 16;
/// Readings further than this from the patch's plane are left out, standard deviations; chosen: normal noise
/// stays within with 99.7 %.
const FIT_SIGMAS: f64 = 3.0;
/// Expected error of a feature's position, pixels; tuned: shared/bags.
const PIXEL_SIGMA: f64 = 0.6;
/// Observations of one point agree within this many standard deviations; chosen: three normal errors stay
/// within with 99.9 %.
const AGREEMENT_SIGMAS: f64 = 4.0;
/// Share of a single observation's deviation left after averaging over any number of views; tuned:
/// shared/bags.
const COMMON_SHARE: f64 = 0.4;

/// One end of a match: where the feature lies in the world, and how well its place is known.
#[derive(Clone, Copy, Debug)]
struct LiftedFeature {
    point: Point3<f64>,
    sigma_m: f64,
}

/// Lifts matches to 3D. The depth of a feature is the depth of the plane through a 5x5 patch (linear in
/// inverse depth) at its sub-pixel position; patches with holes, depth edges or seen at a grazing angle are
/// refused. Features of one state with a match to the same feature of the other are one point, averaged, if
/// they agree in 3D. A pair of points is returned once, and dropped where another pair of either point has
/// more than twice as many pixel matches. See docs/method.md 4.4.
pub fn lifted_matches(
    states: [&[RgbdFrame]; 2],
    matches: &[PixelMatch],
    noise: &NoiseConfig,
) -> Vec<LiftedMatch> {
    let lifted: Vec<Option<[LiftedFeature; 2]>> = matches
        .par_iter()
        .map(|m| {
            let end0 = lifted_feature(states[0].get(m.frame0)?, m.pixel0, noise)?;
            let end1 = lifted_feature(states[1].get(m.frame1)?, m.pixel1, noise)?;
            Some([end0, end1])
        })
        .collect();
    let kept: Vec<(&PixelMatch, [LiftedFeature; 2])> =
        matches.iter().zip(lifted).filter_map(|(m, l)| Some((m, l?))).collect();
    merged_matches(&kept)
}

/// The point at a sub-pixel position by the inverse-depth plane of its surroundings.
fn lifted_feature(frame: &RgbdFrame, [u, v]: [f32; 2], noise: &NoiseConfig) -> Option<LiftedFeature> {
    let k = &frame.intrinsics;
    let cx = u.round() as i64;
    let cy = v.round() as i64;
    if cx < PATCH_PX || cy < PATCH_PX || cx + PATCH_PX >= k.width as i64 || cy + PATCH_PX >= k.height as i64 {
        return None;
    }
    let mut patch = [(0.0, 0.0, 0.0); 25];
    let mut count = 0;
    for y in cy - PATCH_PX..=cy + PATCH_PX {
        for x in cx - PATCH_PX..=cx + PATCH_PX {
            let depth_m = f64::from(frame.depth_m[y as usize * k.width + x as usize]);
            if depth_m > 0.0 {
                patch[count] = (x as f64 - f64::from(u), y as f64 - f64::from(v), 1.0 / depth_m);
                count += 1;
            }
        }
    }
    if count < PATCH_READINGS {
        return None;
    }
    let mut sorted = patch.map(|p| p.2);
    let patch = &patch[..count];
    sorted[..count].sort_by(f64::total_cmp);
    let middle_m = 1.0 / sorted[count / 2];
    // The fall of a surface at the grazing limit over the patch; more is a depth edge.
    let slope_m = PATCH_PX as f64 * middle_m / k.fx * noise.grazing_cosine.acos().tan();
    let limit_m = slope_m + noise.edge_sigmas * noise.sigma_m(middle_m);
    if (1.0 / sorted[0] - 1.0 / sorted[count - 1]).abs() > 2.0 * limit_m {
        return None;
    }
    // Inverse depth of a plane is affine in the pixel, and its noise is even.
    let mut plane = fit_plane(patch.iter().copied())?;
    for _ in 0..2 {
        let depth_m = 1.0 / plane[0];
        let gate = FIT_SIGMAS * noise.sigma_m(depth_m) / (depth_m * depth_m);
        let near = |&(x, y, w): &(f64, f64, f64)| (w - plane.dot(&Vector3::new(1.0, x, y))).abs() < gate;
        if patch.iter().filter(|p| near(p)).count() < PATCH_READINGS {
            return None;
        }
        plane = fit_plane(patch.iter().copied().filter(near))?;
    }
    let depth_m = 1.0 / plane[0];
    let ray = k.ray_at(f64::from(u), f64::from(v));
    // 1 / z = a + b (u - u0) + c (v - v0) is the plane with normal (b fx, c fy, 1 / z - b (u0 - cx) - c (v0 -
    // cy)).
    let normal = Vector3::new(
        plane[1] * k.fx,
        plane[2] * k.fy,
        plane[0] - plane[1] * (f64::from(u) - k.cx) - plane[2] * (f64::from(v) - k.cy),
    );
    let cosine = normal.dot(&ray).abs() / (normal.norm() * ray.norm());
    if !(plane[0] > 0.0 && cosine >= noise.grazing_cosine) {
        return None;
    }
    // docs/method.md (4.2): a slanted surface turns an error of the pixel into a larger one of the point.
    let across_m = PIXEL_SIGMA * depth_m / k.fx / cosine;
    let point = frame.world_from_camera * Point3::from(ray * depth_m);
    let sigma_m = frame.sigma_m(cy as usize * k.width + cx as usize, noise);
    Some(LiftedFeature { point, sigma_m: sigma_m.hypot(across_m) })
}

/// Least-squares `w = a + b x + c y`.
fn fit_plane(patch: impl Iterator<Item = (f64, f64, f64)>) -> Option<Vector3<f64>> {
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (x, y, w) in patch {
        let row = Vector3::new(1.0, x, y);
        normal += row * row.transpose();
        right += row * w;
    }
    normal.cholesky().map(|c| c.solve(&right)).filter(|p| p[0] > 0.0)
}

/// Frame and bits of the pixel of a feature.
type FeatureKey = (usize, [u32; 2]);

/// The feature of one state in a match.
fn feature_key(m: &PixelMatch, state: usize) -> FeatureKey {
    if state == 0 { (m.frame0, m.pixel0.map(f32::to_bits)) } else { (m.frame1, m.pixel1.map(f32::to_bits)) }
}

/// Matches of one pair of merged points.
fn merged_matches(matches: &[(&PixelMatch, [LiftedFeature; 2])]) -> Vec<LiftedMatch> {
    let keys = [0, 1].map(|s| {
        let mut keys: Vec<FeatureKey> = matches.iter().map(|(m, _)| feature_key(m, s)).collect();
        keys.sort_unstable();
        keys.dedup();
        keys
    });
    // Feature indices of both ends of every match.
    let ends: Vec<[usize; 2]> = matches
        .iter()
        .map(|(m, _)| [0, 1].map(|s| keys[s].binary_search(&feature_key(m, s)).unwrap_or_default()))
        .collect();
    let clusters = [0, 1].map(|s| feature_clusters(matches, &ends, s, [keys[0].len(), keys[1].len()]));
    let points = [0, 1].map(|s| cluster_means(matches, &ends, &clusters[s], s));
    let mut pairs: Vec<([usize; 2], usize)> =
        ends.iter().enumerate().map(|(i, e)| ([clusters[0][e[0]], clusters[1][e[1]]], i)).collect();
    pairs.sort_unstable();
    let groups: Vec<&[([usize; 2], usize)]> = pairs.chunk_by(|a, b| a.0 == b.0).collect();
    // Every pixel match is a vote for its pair of points.
    let mut most = [vec![0; keys[0].len()], vec![0; keys[1].len()]];
    for g in &groups {
        for s in 0..2 {
            most[s][g[0].0[s]] = most[s][g[0].0[s]].max(g.len());
        }
    }
    let mut out = Vec::new();
    for g in groups {
        let pair = g[0].0;
        // A point has one partner: a pair with far fewer votes is a wrong match.
        if 2 * g.len() < most[0][pair[0]].max(most[1][pair[1]]) {
            continue;
        }
        let single = |i: usize| matches[i].1[0].sigma_m.hypot(matches[i].1[1].sigma_m);
        let Some(best) =
            g.iter().map(|x| x.1).min_by(|&a, &b| single(a).total_cmp(&single(b)).then(a.cmp(&b)))
        else {
            continue;
        };
        let m = matches[best].0;
        let a = points[0][pair[0]];
        let b = points[1][pair[1]];
        out.push(LiftedMatch {
            point0: a.point,
            point1: b.point,
            sigma_m: a.sigma_m.hypot(b.sigma_m),
            frames: [m.frame0, m.frame1],
            pixels: [m.pixel0, m.pixel1],
        });
    }
    out
}

/// Cluster of every feature of one state: features with a match to one feature of the other state, in
/// agreement in 3D.
fn feature_clusters(
    matches: &[(&PixelMatch, [LiftedFeature; 2])],
    ends: &[[usize; 2]],
    state: usize,
    counts: [usize; 2],
) -> Vec<usize> {
    let mut sets = IndexSets::new(counts[state]);
    let mut order: Vec<usize> = (0..ends.len()).collect();
    order.sort_by_key(|&i| (ends[i][1 - state], ends[i][state]));
    for group in order.chunk_by(|&a, &b| ends[a][1 - state] == ends[b][1 - state]) {
        // All matches of one feature may be true; wrong ones among them do not agree in space.
        for (n, &a) in group.iter().enumerate() {
            for &b in &group[n + 1..] {
                let p = matches[a].1[state];
                let q = matches[b].1[state];
                if (p.point - q.point).norm() < AGREEMENT_SIGMAS * p.sigma_m.hypot(q.sigma_m) {
                    sets.join(ends[a][state], ends[b][state]);
                }
            }
        }
    }
    (0..counts[state]).map(|i| sets.root_of(i)).collect()
}

/// Weighted mean point of every cluster, by the index of its root. See docs/method.md (4.3).
fn cluster_means(
    matches: &[(&PixelMatch, [LiftedFeature; 2])],
    ends: &[[usize; 2]],
    clusters: &[usize],
    state: usize,
) -> Vec<LiftedFeature> {
    let mut readings: Vec<Option<LiftedFeature>> = vec![None; clusters.len()];
    for (m, e) in matches.iter().zip(ends) {
        // A feature counts once, in however many matches it takes part.
        readings[e[state]] = Some(m.1[state]);
    }
    let mut sums = vec![(0.0, Vector3::zeros(), 0.0f64); clusters.len()];
    for (i, r) in readings.iter().enumerate() {
        let Some(r) = r else { continue };
        let weight = r.sigma_m.powi(-2);
        let sum = &mut sums[clusters[i]];
        sum.0 += weight;
        sum.1 += r.point.coords * weight;
        sum.2 += 1.0;
    }
    sums.into_iter()
        .map(|(weight, point, count)| {
            let weight = f64::max(weight, 1e-12);
            // Views share errors of the camera and of the features: the mean is not as good as 1 /
            // sqrt(count).
            let common = COMMON_SHARE * (count / weight).sqrt();
            let sigma_m = if count > 1.0 { weight.sqrt().recip().max(common) } else { weight.sqrt().recip() };
            LiftedFeature { point: Point3::from(point / weight), sigma_m }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::synthetic::{Scene, camera_ring};

    #[test]
    fn the_depth_plane_gives_the_surface_point_at_sub_pixels() {
        let scene = Scene::box_with_lid();
        let frame = &scene.frames(0, &camera_ring(4))[0];
        let noise = NoiseConfig::default();
        let mut seen = 0;
        let mut exact = 0;
        for i in 0..40u8 {
            let pixel = [120.3 + 2.3 * f32::from(i), 90.7 + 1.9 * f32::from(i)];
            if let Some(r) = lifted_feature(frame, pixel, &noise) {
                let truth = scene.ray_hit(0, frame, pixel).expect("a reading is on the surface");
                let error_m = (r.point - truth).norm();
                assert!(error_m < 3.0 * r.sigma_m, "{error_m}");
                seen += 1;
                // Patches across a crease fit neither face.
                exact += usize::from(error_m < 2e-4);
            }
        }
        assert!(seen > 10 && exact * 10 > seen * 7, "{exact} of {seen}");
    }

    #[test]
    fn edges_holes_and_borders_are_refused() {
        let scene = Scene::box_with_lid();
        let mut frame = scene.frames(0, &camera_ring(4)).remove(0);
        let noise = NoiseConfig::default();
        let w = frame.intrinsics.width;
        let pixel = (0..w * 240).find(|&i| frame.depth_m[i] > 0.0).map(|i| [(i % w) as f32, (i / w) as f32]);
        let pixel = pixel.expect("the object is in the picture");
        assert!(lifted_feature(&frame, pixel, &noise).is_none(), "silhouette");
        assert!(lifted_feature(&frame, [0.0, 0.0], &noise).is_none());
        let inner = (0..400)
            .map(|i| [100.0 + (i % 20) as f32 * 6.0, 80.0 + (i / 20) as f32 * 5.0])
            .find(|p| lifted_feature(&frame, *p, &noise).is_some());
        let [u, v] = inner.expect("a pixel on the object");
        let x = u as usize;
        let y = v as usize;
        for i in 0..5 {
            (0..5).for_each(|j| frame.depth_m[(y + j - 2) * w + x + i - 2] += if i < 2 { 0.0 } else { 0.08 });
        }
        assert!(lifted_feature(&frame, [u, v], &noise).is_none(), "depth edge");
    }

    #[test]
    fn views_that_agree_become_one_match_and_contradicted_ones_go() {
        let r = |x: f64| LiftedFeature { point: Point3::new(x, 0.0, 1.0), sigma_m: 0.001 };
        let m = |f0: usize, p0: f32, f1: usize, p1: f32| PixelMatch {
            frame0: f0,
            pixel0: [p0, 0.0],
            frame1: f1,
            pixel1: [p1, 0.0],
        };
        // Point A: features (0, 10) and (1, 11) of state 0, (0, 20) and (1, 21) of state 1; a wrong match
        // leads to B.
        let list = [
            m(0, 10.0, 0, 20.0),
            m(0, 10.0, 1, 21.0),
            m(1, 11.0, 0, 20.0),
            m(1, 11.0, 1, 21.0),
            m(0, 10.0, 2, 55.0),
        ];
        let ends = [
            [r(0.0), r(0.5)],
            [r(0.0), r(0.501)],
            [r(0.001), r(0.5)],
            [r(0.001), r(0.501)],
            [r(0.0), r(0.9)],
        ];
        let out = merged_matches(&list.iter().zip(ends).collect::<Vec<_>>());
        assert_eq!(out.len(), 1);
        assert!((out[0].point0.x - 0.0005).abs() < 1e-9 && (out[0].point1.x - 0.5005).abs() < 1e-9);
        assert!(out[0].sigma_m < 0.001 * 2f64.sqrt());
        // Two points that match the same feature but lie apart stay apart.
        let list = [m(0, 10.0, 0, 20.0), m(1, 11.0, 0, 20.0)];
        let out = merged_matches(&list.iter().zip([[r(0.0), r(0.5)], [r(0.3), r(0.5)]]).collect::<Vec<_>>());
        assert_eq!(out.len(), 2);
    }
}
